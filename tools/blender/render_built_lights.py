"""render_built_lights.py FOLDER SAMPLES: Cycles looks straight down at the floor of FOLDER/NAME.usda for each NAME in
FOLDER/lights.json and writes FOLDER/NAME.exr, as render_lights.py does. Blender's importer knows no focus, profile or projector, so
each light is built anew out of nodes from its numbers, by what UsdLux says of them; `sky` keeps what the importer made of a dome.

A light: `kind` (point, disk, plane, sky), `matrix` (rows, world from light, Y up), `intensity` [cd] of a point or `radiance` [nit],
`size` of a disk or plane [m], and as far as it has them `cone` [degrees], `softness`, `focus`, `ies`, `fov` [degrees], `picture`.
"""

import json
import math
import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parent), str(Path(__file__).resolve().parent.parent)]
import bpy
from floor import look_down, open_white
from mathutils import Matrix

# Blender turns candela into watts by these lumens per watt, and its own point lights divide by 4 pi.
IES_LUMENS = 177.83


class Nodes:
    """Arithmetic as nodes of one tree."""

    def __init__(self, tree):
        self.tree = tree

    def new(self, kind: str, **settings):
        node = self.tree.nodes.new(kind)
        for key, value in settings.items():
            setattr(node, key, value)
        return node

    def feed(self, socket, value) -> None:
        if isinstance(value, bpy.types.NodeSocket):
            self.tree.links.new(value, socket)
        else:
            socket.default_value = value

    def math(self, operation: str, *values, clamp: bool = False):
        node = self.new("ShaderNodeMath", operation=operation, use_clamp=clamp)
        for socket, value in zip(node.inputs, values):
            self.feed(socket, value)
        return node.outputs[0]

    def dot(self, a, b):
        node = self.new("ShaderNodeVectorMath", operation="DOT_PRODUCT")
        self.feed(node.inputs[0], a)
        self.feed(node.inputs[1], b)
        return node.outputs["Value"]

    def vector(self, x, y, z):
        node = self.new("ShaderNodeCombineXYZ")
        for socket, value in zip(node.inputs, (x, y, z)):
            self.feed(socket, value)
        return node.outputs[0]

    def scaled(self, vector, factor):
        node = self.new("ShaderNodeVectorMath", operation="SCALE")
        self.feed(node.inputs[0], vector)
        self.feed(node.inputs["Scale"], factor)
        return node.outputs[0]


def shaping(nodes: Nodes, light: dict, cos):
    """UsdLux ShapingAPI: |cos|^focus, times a smooth step from the cone's soft start to its angle."""
    cone = math.radians(light.get("cone", 180))
    start = cone * (1 - light.get("softness", 0))
    theta = nodes.math("ARCCOSINE", nodes.math("MINIMUM", cos, 1.0))
    t = nodes.math("DIVIDE", nodes.math("SUBTRACT", theta, start), max(cone - start, 1e-6), clamp=True)
    step = nodes.math("MULTIPLY", nodes.math("MULTIPLY", t, t), nodes.math("SUBTRACT", 3.0, nodes.math("MULTIPLY", t, 2.0)))
    focus = nodes.math("POWER", nodes.math("ABSOLUTE", cos), float(light.get("focus", 0)))
    return nodes.math("MULTIPLY", nodes.math("SUBTRACT", 1.0, step), focus)


def thrown(nodes: Nodes, light: dict, image, x, y, cos):
    """The picture that a pinhole throws along the light's axis, +Y up; black around it."""
    half = math.tan(math.radians(light["fov"]) / 2)
    across = nodes.math("DIVIDE", nodes.math("DIVIDE", x, cos), 2 * half)
    up = nodes.math("DIVIDE", nodes.math("DIVIDE", y, cos), 2 * half * image.size[1] / image.size[0])
    node = nodes.new("ShaderNodeTexImage", image=image, extension="CLIP")
    nodes.feed(node.inputs[0], nodes.vector(nodes.math("ADD", across, 0.5), nodes.math("ADD", up, 0.5), 0.0))
    return nodes.scaled(node.outputs["Color"], nodes.math("GREATER_THAN", cos, 0.0))


def build_lamp(light: dict, matrix: Matrix, folder: Path) -> None:
    """A point or disk whose strength goes by the direction in its own axes."""
    is_point = light["kind"] == "point"
    data = bpy.data.lights.new("lamp", "POINT" if is_point else "AREA")
    data.color = (1, 1, 1)
    if is_point:
        data.normalize, data.use_soft_falloff, data.shadow_soft_size = True, False, 0.001
        data.energy = 4 * math.pi * light["intensity"]
    else:
        data.shape, data.size = "DISK", light["size"]
        data.energy = math.pi * math.pi * (light["size"] / 2) ** 2 * light["radiance"]
    data.use_nodes = True
    data.node_tree.nodes.clear()
    nodes = Nodes(data.node_tree)
    travel = nodes.new("ShaderNodeNewGeometry").outputs["Incoming"]
    x, y, z = (nodes.dot(travel, tuple(matrix.to_3x3().col[k].normalized())) for k in range(3))
    cos = nodes.math("MULTIPLY", z, -1.0)
    strength = shaping(nodes, light, cos)
    if "ies" in light:
        # UsdLux' reference renderer has 0 degrees at -X, turning towards -Y; Blender at -Y, turning towards -X.
        profile = nodes.new("ShaderNodeTexIES", mode="EXTERNAL", filepath=str(folder / light["ies"]))
        nodes.feed(profile.inputs["Vector"], nodes.vector(y, x, z))
        candela = nodes.math("MULTIPLY", profile.outputs[0], IES_LUMENS / (4 * math.pi))
        strength = nodes.math("MULTIPLY", strength, candela)
    emission = nodes.new("ShaderNodeEmission")
    if "fov" in light:
        image = bpy.data.images.load(str(folder / light["picture"]))
        nodes.feed(emission.inputs["Color"], thrown(nodes, light, image, x, y, cos))
    nodes.feed(emission.inputs["Strength"], strength)
    nodes.tree.links.new(emission.outputs[0], nodes.new("ShaderNodeOutputLight").inputs[0])
    lamp = bpy.data.objects.new("lamp", data)
    bpy.context.scene.collection.objects.link(lamp)
    lamp.matrix_world, lamp.visible_camera = matrix, False


def build_plane(light: dict, matrix: Matrix, folder: Path) -> None:
    """A rectangle with a picture on it, upright for whoever looks at its shining side: the picture's left is at +X."""
    half = light["size"] / 2
    mesh = bpy.data.meshes.new("plane")
    corners = [(half, half, 0), (half, -half, 0), (-half, -half, 0), (-half, half, 0)]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    uv = mesh.uv_layers.new(name="uv")
    for loop, at in zip(uv.data, [(0, 1), (0, 0), (1, 0), (1, 1)]):
        loop.uv = at
    material = bpy.data.materials.new("plane")
    material.use_nodes = True
    material.node_tree.nodes.clear()
    nodes = Nodes(material.node_tree)
    picture = nodes.new("ShaderNodeTexImage", image=bpy.data.images.load(str(folder / light["picture"])), extension="EXTEND")
    emission = nodes.new("ShaderNodeEmission")
    nodes.feed(emission.inputs["Color"], picture.outputs["Color"])
    nodes.feed(emission.inputs["Strength"], light["radiance"])
    nodes.tree.links.new(emission.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    mesh.materials.append(material)
    plane = bpy.data.objects.new("plane", mesh)
    bpy.context.scene.collection.objects.link(plane)
    plane.matrix_world, plane.visible_camera = matrix, False


def main() -> None:
    folder, samples = Path(sys.argv[1]), int(sys.argv[2])
    lights = json.loads((folder / "lights.json").read_text())
    for name, light in lights.items():
        open_white(folder / f"{name}.usda", sky=light["kind"] == "sky")
        for thing in [o for o in bpy.context.scene.objects if o.type == "LIGHT"]:
            bpy.data.objects.remove(thing)
        # Y up to Z up.
        matrix = Matrix.Rotation(math.pi / 2, 4, "X") @ Matrix(light["matrix"])
        if light["kind"] == "plane":
            build_plane(light, matrix, folder)
        elif light["kind"] != "sky":
            build_lamp(light, matrix, folder)
        look_down(folder / f"{name}.exr", samples)
    print(json.dumps({"rendered": len(lights)}))


main()
