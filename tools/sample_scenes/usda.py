"""Scenes as usda text: UsdGeom meshes with faceVarying normals, UsdPreviewSurface materials, a camera."""

from math import radians, tan

from .model import Camera, Material, Mesh, Scene


def number(v: float) -> str:
    """The shortest decimal with at most seven digits, without a negative zero."""
    text = f"{v:.7g}"
    return "0" if float(text) == 0 else text


def tuple_of(values) -> str:
    return "(" + ", ".join(number(v) for v in values) + ")"


def list_of(rows) -> str:
    return "[" + ", ".join(tuple_of(r) if isinstance(r, tuple) else str(r) for r in rows) + "]"


def indent(text: str, by: int = 4) -> str:
    return "".join(" " * by + line if line.strip() else line for line in text.splitlines(keepends=True))


def layer(comment: str, root: str, body: str, up_axis: str = "Y", extra: str = "") -> str:
    """A whole layer with `root` as its default prim; `extra` stands at the root level beside it."""
    return (
        f'#usda 1.0\n(\n    defaultPrim = "{root}"\n    doc = "{comment}"\n    metersPerUnit = 1\n    upAxis = "{up_axis}"\n)\n\n'
        f'def Xform "{root}" (\n    kind = "component"\n)\n{{\n{indent(body)}}}\n{extra}'
    )


def mesh(m: Mesh, materials: str) -> str:
    """A polygon mesh, bound to `<materials>/<name>`."""
    normals = [m.normal(face) for face in m.faces for _ in face]
    low = tuple(min(p[k] for p in m.points) for k in range(3))
    high = tuple(max(p[k] for p in m.points) for k in range(3))
    uvs = ""
    if m.uvs is not None:
        uvs = f'texCoord2f[] primvars:st = {list_of(m.uvs)} (\n    interpolation = "faceVarying"\n)\n'
    body = (
        f"uniform bool doubleSided = {int(m.double_sided)}\nfloat3[] extent = {list_of([low, high])}\n"
        f"int[] faceVertexCounts = {list_of([len(f) for f in m.faces])}\n"
        f"int[] faceVertexIndices = {list_of([i for f in m.faces for i in f])}\n"
        f"rel material:binding = <{materials}/{m.material}>\n"
        f'normal3f[] normals = {list_of(normals)} (\n    interpolation = "faceVarying"\n)\n'
        f"point3f[] points = {list_of(m.points)}\n{uvs}"
        'uniform token subdivisionScheme = "none"\n'
    )
    return f'def Mesh "{m.name}" (\n    prepend apiSchemas = ["MaterialBindingAPI"]\n)\n{{\n{indent(body)}}}\n\n'


def material(m: Material, materials: str) -> str:
    """A UsdPreviewSurface without any specular reflection."""
    path = f"{materials}/{m.name}"
    if m.texture:
        diffuse = f"color3f inputs:diffuseColor.connect = <{path}/texture.outputs:rgb>\n"
    else:
        diffuse = f"color3f inputs:diffuseColor = {tuple_of(m.albedo)}\n"
    emission = f"color3f inputs:emissiveColor = {tuple_of(m.emission)}\n" if max(m.emission) > 0 else ""
    surface = (
        'uniform token info:id = "UsdPreviewSurface"\n' + diffuse + emission
        + "float inputs:roughness = 1\ncolor3f inputs:specularColor = (0, 0, 0)\nint inputs:useSpecularWorkflow = 1\n"
        "token outputs:surface\n"
    )
    body = f'token outputs:surface.connect = <{path}/surface.outputs:surface>\n\ndef Shader "surface"\n{{\n{indent(surface)}}}\n'
    if m.texture:
        texture = (
            f'uniform token info:id = "UsdUVTexture"\nasset inputs:file = @./{m.texture}@\n'
            f'token inputs:sourceColorSpace = "sRGB"\nfloat2 inputs:st.connect = <{path}/st.outputs:result>\n'
            'token inputs:wrapS = "repeat"\ntoken inputs:wrapT = "repeat"\nfloat3 outputs:rgb\n'
        )
        reader = 'uniform token info:id = "UsdPrimvarReader_float2"\nstring inputs:varname = "st"\nfloat2 outputs:result\n'
        body += f'\ndef Shader "texture"\n{{\n{indent(texture)}}}\n\ndef Shader "st"\n{{\n{indent(reader)}}}\n'
    return f'def Material "{m.name}"\n{{\n{indent(body)}}}\n\n'


def scope(name: str, body: str) -> str:
    return f'def Scope "{name}"\n{{\n{indent(body.rstrip() + chr(10))}}}\n\n'


def camera(c: Camera) -> str:
    """A camera with a film as high as the scene's aspect asks for, 24 mm high."""
    film = 24.0
    focal = film / 2 / tan(radians(c.fov) / 2)
    turned = c.yaw or c.pitch
    turn = f"double3 xformOp:rotateXYZ = {tuple_of((c.pitch, c.yaw, 0))}\n" if turned else ""
    order = '["xformOp:translate", "xformOp:rotateXYZ"]' if turned else '["xformOp:translate"]'
    body = (
        f"float2 clippingRange = (0.01, 1000)\nfloat focalLength = {number(focal)}\n"
        f"float horizontalAperture = {number(film * c.aspect)}\nfloat verticalAperture = {number(film)}\n{turn}"
        f"double3 xformOp:translate = {tuple_of(c.eye)}\nuniform token[] xformOpOrder = {order}\n"
    )
    return f'def Camera "camera"\n{{\n{indent(body)}}}\n\n'


def write(scene: Scene) -> str:
    """A scene of meshes alone, without lights."""
    root = f"/{scene.name}"
    body = "".join(mesh(m, f"{root}/materials") for m in scene.meshes)
    if scene.camera:
        body += camera(scene.camera)
    body += scope("materials", "".join(material(m, f"{root}/materials") for m in scene.materials))
    return layer(scene.comment, scene.name, body)
