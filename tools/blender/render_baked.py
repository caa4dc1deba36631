"""render_baked.py BAKED.glb OUT.exr WIDTH HEIGHT: shows a baked GLB from its lightmap; no light is computed.

Each surface gets UV map -> page (Non-Color) -> times base colour (over pi where the page is irradiance), plus its own emission ->
Emission.
"""

import json
import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import bpy
import path_tracer


# From a texel to what a white wall sends out.
RADIANCE = {"outgoing": 1, "irradiance": 1 / math.pi}


def show_lightmap(material, uv_name: str, image, place: dict, radiance: float) -> None:
    _, _, emission = path_tracer.base_colour(material)
    tree, colour, output = path_tracer.own_colour(material)
    uv = tree.nodes.new("ShaderNodeUVMap")
    uv.uv_map = uv_name
    mapping = tree.nodes.new("ShaderNodeMapping")
    (sx, sy), (ox, oy) = place["scale"], place["offset"]
    # Blender turns v up on import: v_page = 1 - (oy + sy (1 - v)).
    mapping.inputs["Scale"].default_value = (sx, sy, 1)
    mapping.inputs["Location"].default_value = (ox, 1 - oy - sy, 0)
    page = tree.nodes.new("ShaderNodeTexImage")
    page.image, page.interpolation, page.extension = image, "Linear", "EXTEND"
    tree.links.new(uv.outputs[0], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs[0], page.inputs["Vector"])
    scale = path_tracer.colour_node(tree, (radiance,) * 3 + (1,), None)
    reflected = path_tracer.product(tree, path_tracer.product(tree, page.outputs["Color"], colour), scale)
    own = tree.nodes.new("ShaderNodeRGB")
    own.outputs[0].default_value = (*emission, 1)
    shader = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(path_tracer.total(tree, reflected, own.outputs[0]), shader.inputs["Color"])
    tree.links.new(shader.outputs[0], output.inputs["Surface"])


def main() -> None:
    baked, out = Path(sys.argv[1]), Path(sys.argv[2])
    width, height = int(sys.argv[3]), int(sys.argv[4])
    path_tracer.open_scene(baked)
    radiance = RADIANCE[path_tracer.lumel_of(baked)["quantity"]]
    pages: dict[str, object] = {}
    shown = 0
    for o in path_tracer.mesh_objects():
        extras = o.get("lumel")
        if extras is None:
            continue
        place = {"scale": list(extras["scale"]), "offset": list(extras["offset"])}
        uri = page_uri(baked, int(extras["page"]))
        if uri not in pages:
            pages[uri] = bpy.data.images.load(str(baked.parent / uri))
            pages[uri].colorspace_settings.name = "Non-Color"
        uv_name = o.data.uv_layers[int(extras["texCoord"])].name
        o.data = o.data.copy()
        for slot in range(len(o.data.materials)):
            o.data.materials[slot] = o.data.materials[slot].copy()
            show_lightmap(o.data.materials[slot], uv_name, pages[uri], place, radiance)
        shown += 1
    path_tracer.render(width, height, 16, out)
    print(json.dumps({"out": str(out), "surfaces": shown, "pages": sorted(pages)}))


def page_uri(baked: Path, page: int) -> str:
    """The page's file."""
    return path_tracer.pages_of(baked)[page]["uri"]


main()
