"""The triangles of a baked GLB in world space, with their place on the lightmap pages and what their material says."""

from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from .display import linear_from_srgb
from .gltf import Document, local_matrix
from .pages import Page, bilinear, nearest, read_page


@dataclass
class Look:
    """What a picture needs of a material; each texture is (RGBA linear, uv set, 2 x 3 transform, whether it is filtered)."""

    name: str = ""
    base: np.ndarray = field(default_factory=lambda: np.ones(4))
    base_texture: tuple | None = None
    emission: np.ndarray = field(default_factory=lambda: np.zeros(3))
    emission_texture: tuple | None = None
    double_sided: bool = False
    cutoff: float | None = None
    unlit: bool = False


@dataclass
class Triangles:
    """Structure of arrays over T triangles."""

    position: np.ndarray  # (T, 3, 3) world [m]
    page_uv: np.ndarray  # (T, 3, 2) v down
    page: np.ndarray  # (T,) -1: no lightmap
    node: np.ndarray  # (T,) index into names
    look: np.ndarray  # (T,) index into looks
    uv: np.ndarray  # (S, T, 3, 2) texture coordinates by set
    color: np.ndarray  # (T, 3, 4) vertex colours, 1 where there are none
    irradiance: np.ndarray  # (T, 3, 3) the attribute _IRRADIANCE, NaN where there is none
    names: list[str]
    looks: list[Look]
    pages: list[Page]
    lumel: dict
    flat: bool = False  # each texel one value, unfiltered, in place of bilinear

    def normals(self) -> np.ndarray:
        """Geometric normals, not normalized: twice the area long."""
        p = self.position
        return np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])

    def areas(self) -> np.ndarray:
        return np.linalg.norm(self.normals(), axis=1) / 2


SETS = 4
NEAREST = 9728  # a sampler's filter


def load(path: Path | str, pages: Path | str | None = None) -> Triangles:
    """Reads a GLB and the pages it lists, or in their place those whose file names are `pages` and then `<number>.exr`."""
    doc = Document(path)
    looks = [_look(doc, m) for m in doc.json.get("materials", [])] + [Look()]
    parts: dict[str, list] = {k: [] for k in ("position", "page_uv", "page", "node", "look", "uv", "color", "irradiance")}
    names: list[str] = []
    for node, world in doc.placed_nodes():
        if "mesh" not in node:
            continue
        name = node.get("name", f"node {len(names)}")
        for name, world, lumel in _instances(doc, node, name, world):
            names.append(name)
            _add(doc, node, world, lumel, len(names) - 1, len(looks) - 1, parts)
    if not names:
        raise SystemExit(f"{path}: holds no mesh")
    lumel = doc.lumel()
    folder = Path(path).parent
    files = [folder / unquote(p["uri"]) for p in lumel.get("pages", [])]
    if pages is not None:
        files = [Path(f"{pages}{k}.exr") for k in range(len(files))]
    joined = {k: np.concatenate(v, axis=1 if k == "uv" else 0) for k, v in parts.items()}
    return Triangles(**joined, names=names, looks=looks, pages=[read_page(f) for f in files], lumel=lumel)


def _instances(doc: Document, node: dict, name: str, world: np.ndarray) -> list[tuple[str, np.ndarray, dict | None]]:
    """Name, world matrix and placement of each time that a node draws its mesh: once, or as EXT_mesh_gpu_instancing says."""
    lumel = (node.get("extras") or {}).get("lumel")
    attributes = (node.get("extensions") or {}).get("EXT_mesh_gpu_instancing", {}).get("attributes")
    if not attributes:
        return [(name, world, lumel)]
    values = {key: doc.accessor(index) for key, index in attributes.items()}
    all = []
    for k in range(max(len(v) for v in values.values())):
        keys = {"TRANSLATION": "translation", "ROTATION": "rotation", "SCALE": "scale"}
        local = local_matrix({to: values[key][k].tolist() for key, to in keys.items() if key in values})
        own = dict(lumel) if lumel else None
        if own is not None and "_LUMEL_RECT" in values:
            rectangle = values["_LUMEL_RECT"][k]
            own |= {"scale": rectangle[:2], "offset": rectangle[2:], "page": int(values["_LUMEL_PAGE"][k][0])}
            if not rectangle.any():  # no lightmap
                own = None
        all.append((f"{name}[{k}]", world @ local, own))
    return all


def _add(doc: Document, node: dict, world: np.ndarray, lumel: dict | None, number: int, plain: int, parts: dict) -> None:
    """Adds the triangles of a node's mesh at one place to `parts`; `plain` is the look of those without a material."""
    for primitive in doc.json["meshes"][node["mesh"]]["primitives"]:
        tri = doc.triangles(primitive)
        if tri is None:
            continue
        if np.linalg.det(world[:3, :3]) < 0:
            tri = tri[:, [0, 2, 1]]
        attributes = primitive["attributes"]
        position = doc.accessor(attributes["POSITION"]).astype(float) @ world[:3, :3].T + world[:3, 3]
        count = len(tri)
        key = f"TEXCOORD_{lumel.get('texCoord', 1)}" if lumel else ""
        page, page_uv = -1, np.zeros((len(position), 2))
        if key in attributes and "page" in lumel:
            page = lumel["page"]
            page_uv = doc.accessor(attributes[key]) * lumel.get("scale", [1, 1]) + lumel.get("offset", [0, 0])
        uv = np.zeros((SETS, count, 3, 2))
        for s in range(SETS):
            if f"TEXCOORD_{s}" in attributes:
                uv[s] = doc.accessor(attributes[f"TEXCOORD_{s}"])[tri]
        color = np.ones((len(position), 4))
        if "COLOR_0" in attributes:
            given = doc.accessor(attributes["COLOR_0"])
            color[:, : given.shape[1]] = given
        irradiance = np.full((len(position), 3), np.nan)
        if "_IRRADIANCE" in attributes:
            irradiance[:] = doc.accessor(attributes["_IRRADIANCE"])[:, :3]
        parts["position"].append(position[tri])
        parts["page_uv"].append(page_uv[tri])
        parts["page"].append(np.full(count, page))
        parts["node"].append(np.full(count, number))
        parts["look"].append(np.full(count, primitive.get("material", plain)))
        parts["uv"].append(uv)
        parts["color"].append(color[tri])
        parts["irradiance"].append(irradiance[tri])


def _look(doc: Document, material: dict) -> Look:
    pbr = material.get("pbrMetallicRoughness", {})
    extensions = material.get("extensions", {})
    strength = extensions.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0)
    return Look(
        name=material.get("name", ""),
        base=np.array(pbr.get("baseColorFactor", [1, 1, 1, 1]), float),
        base_texture=_texture(doc, pbr.get("baseColorTexture")),
        emission=np.array(material.get("emissiveFactor", [0, 0, 0]), float) * strength,
        emission_texture=_texture(doc, material.get("emissiveTexture")),
        double_sided=material.get("doubleSided", False),
        cutoff=material.get("alphaCutoff", 0.5) if material.get("alphaMode") == "MASK" else None,
        unlit="KHR_materials_unlit" in extensions,
    )


def _texture(doc: Document, slot: dict | None) -> tuple | None:
    if slot is None:
        return None
    source = doc.json["textures"][slot["index"]].get("source")
    if source is None:  # held by an extension (KTX2, WebP) that is not read here
        return None
    rgba = doc.image(source).astype(float)
    rgba[..., :3] = linear_from_srgb(rgba[..., :3])
    transform = slot.get("extensions", {}).get("KHR_texture_transform", {})
    (ox, oy), (sx, sy), r = transform.get("offset", [0, 0]), transform.get("scale", [1, 1]), transform.get("rotation", 0)
    c, s = np.cos(r), np.sin(r)
    matrix = np.array([[c * sx, s * sy, ox], [-s * sx, c * sy, oy]])
    sampler = doc.json["textures"][slot["index"]].get("sampler")
    is_filtered = sampler is None or doc.json["samplers"][sampler].get("magFilter") != NEAREST
    return rgba, transform.get("texCoord", slot.get("texCoord", 0)), matrix, is_filtered


def texture_at(texture: tuple, t: Triangles, triangle: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """RGBA of a material's texture at barycentric `weights` (N, 3) of the triangles (N,)."""
    rgba, uv_set, matrix, is_filtered = texture
    uv = (t.uv[min(uv_set, SETS - 1)][triangle] * weights[..., None]).sum(1)
    at = uv @ matrix[:, :2].T + matrix[:, 2]
    return bilinear(rgba, at, wrap=True) if is_filtered else nearest(rgba, at % 1)


def albedo_at(t: Triangles, triangle: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Base colour RGBA, linear: factor x texture x vertex colour (the last not where it holds the bake)."""
    out = np.empty((len(triangle), 4))
    for k in np.unique(t.look[triangle]):
        at = t.look[triangle] == k
        out[at] = t.looks[k].base
        if t.looks[k].base_texture is not None:
            out[at] *= texture_at(t.looks[k].base_texture, t, triangle[at], weights[at])
    if "vertexScale" not in t.lumel:
        out *= (t.color[triangle] * weights[..., None]).sum(1)
    return out


def emission_at(t: Triangles, triangle: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Emitted radiance RGB [nit]."""
    out = np.zeros((len(triangle), 3))
    for k in np.unique(t.look[triangle]):
        look, at = t.looks[k], t.look[triangle] == k
        if look.emission.max() > 0:
            out[at] = look.emission
            if look.emission_texture is not None:
                out[at] *= texture_at(look.emission_texture, t, triangle[at], weights[at])[:, :3]
    return out


def lightmap_at(t: Triangles, triangle: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Lightmap value RGB in the file's quantity, NaN where the triangle has no lightmap."""
    out = np.full((len(triangle), 3), np.nan)
    uv = (t.page_uv[triangle] * weights[..., None]).sum(1)
    for k, page in enumerate(t.pages):
        at = t.page[triangle] == k
        out[at] = (nearest if t.flat else bilinear)(page.rgb, uv[at])
    return out


def radiance_at(t: Triangles, triangle: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The radiance [nit] that a diffuse surface sends out, as an engine would compute it from the bake."""
    albedo, emission = albedo_at(t, triangle, weights)[:, :3], emission_at(t, triangle, weights)
    if "vertexScale" in t.lumel:
        value = (t.color[triangle][..., :3] * weights[..., None]).sum(1)
        return albedo * value * t.lumel["vertexScale"]
    value = np.nan_to_num(lightmap_at(t, triangle, weights))
    match t.lumel.get("quantity", "outgoing"):
        case "outgoing":
            return albedo * value + emission
        case "irradiance":
            return albedo * value / np.pi + emission
        case _:
            lit = t.page[triangle] >= 0
            return np.where(lit[:, None], value / np.pi, emission)
