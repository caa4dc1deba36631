"""bake_pages.py BAKED.glb FOLDER SAMPLES [--sky R,G,B] [--sun-angle DEGREES]: Cycles bakes the pages of a baked GLB in its place.

FOLDER gets a copy of the GLB and pages of the same names and sizes that hold E / pi by Cycles: SAMPLES paths a texel, 64 bounces,
nothing clamped, no denoising, a margin of 2 texels. Materials become diffuse with the colour they had, normals geometric. Prints the
CPU and wall time of the bake calls alone.
"""

import argparse
import json
import math
import shutil
import sys
import time
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parent), str(Path(__file__).resolve().parent.parent)]
import bpy
import numpy as np
import path_tracer
from baked.gltf import Document

MARGIN = 2
# Cycles divides by the albedo, so there must be one [1].
LEAST_ALBEDO = 1e-3
UV = "lumel_page"
# Twice the area of a triangle over the square of its longest side, below which it is a line.
LEAST_SHAPE = 1e-6


def make_diffuse(material) -> None:
    """The colour and emission it had; emission on the front only, as glTF has it of a single-sided material."""
    factor, image, emission = path_tracer.base_colour(material)
    is_single_sided = material.use_backface_culling
    tree, output = path_tracer.fresh(material)
    shader = tree.nodes.new("ShaderNodeBsdfDiffuse")
    factor = (*(max(v, LEAST_ALBEDO) for v in factor[:3]), 1)
    tree.links.new(path_tracer.colour_node(tree, factor, image), shader.inputs["Color"])
    result = shader.outputs[0]
    if max(emission) > 0:
        glow = tree.nodes.new("ShaderNodeEmission")
        glow.inputs["Color"].default_value = (*emission, 1)
        both = tree.nodes.new("ShaderNodeAddShader")
        tree.links.new(result, both.inputs[0])
        tree.links.new(glow.outputs[0], both.inputs[1])
        result = both.outputs[0]
        if is_single_sided:
            side, mix = tree.nodes.new("ShaderNodeNewGeometry"), tree.nodes.new("ShaderNodeMixShader")
            tree.links.new(side.outputs["Backfacing"], mix.inputs[0])
            tree.links.new(result, mix.inputs[1])
            tree.links.new(shader.outputs[0], mix.inputs[2])
            result = mix.outputs[0]
            material.cycles.emission_sampling = "FRONT"
    tree.links.new(result, output.inputs["Surface"])


def meshes(baked: Path) -> dict[int, object]:
    """An object for each page of all triangles on it (-1: on none), with UVs over the page and geometric normals.

    They take the place of the imported ones: Cycles would build its scene anew for each object, and triangles without area, whose
    corners may lie on several charts, would be baked over others.
    """
    document = Document(baked)
    names = [m.get("name", "") for m in document.json.get("materials", [])]
    parts: dict[int, list] = {}
    for node, world in document.placed_nodes():
        placed = (node.get("extras") or {}).get("lumel") or {}
        for primitive in document.json["meshes"][node["mesh"]]["primitives"] if "mesh" in node else []:
            corners = document.triangles(primitive)
            if corners is None:
                continue
            if np.linalg.det(world[:3, :3]) < 0:
                corners = corners[:, [0, 2, 1]]
            position = document.accessor(primitive["attributes"]["POSITION"]) @ world[:3, :3].T + world[:3, 3]
            corners = corners[has_area(position[corners])].ravel()
            position = position[corners]
            read = lambda name: document.accessor(primitive["attributes"][name])[corners]
            uv, page = np.zeros((len(corners), 2)), -1
            if "page" in placed:
                uv, page = read(f"TEXCOORD_{placed['texCoord']}") * placed["scale"] + placed["offset"], placed["page"]
            material = np.full(len(corners) // 3, primitive.get("material", len(names)))
            texture = read("TEXCOORD_0") if "TEXCOORD_0" in primitive["attributes"] else np.zeros((len(corners), 2))
            parts.setdefault(page, []).append((position, texture, uv, material))
    for o in path_tracer.mesh_objects():
        bpy.data.objects.remove(o)
    grey = bpy.data.materials.new("none")
    materials = [*(bpy.data.materials.get(name, grey) for name in names), grey]
    return {page: mesh_object(f"page{page}", *(np.concatenate(part) for part in zip(*found)), materials) for page, found in parts.items()}


def has_area(triangles: np.ndarray) -> np.ndarray:
    """Which of (T, 3, 3) are more than lines, to the accuracy of floats."""
    a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    longest = np.maximum((a * a).sum(1), (b * b).sum(1))
    return np.linalg.norm(np.cross(a, b), axis=1) > LEAST_SHAPE * longest


def mesh_object(name: str, position, texture, uv, material, materials: list):
    """A mesh whose triangles share no vertices; y and v turn up as Blender has them."""
    mesh, count = bpy.data.meshes.new(name), len(position)
    mesh.vertices.add(count)
    mesh.vertices.foreach_set("co", np.stack([position[:, 0], -position[:, 2], position[:, 1]], 1).astype(np.float32).ravel())
    mesh.loops.add(count)
    mesh.loops.foreach_set("vertex_index", np.arange(count, dtype=np.int32))
    mesh.polygons.add(count // 3)
    mesh.polygons.foreach_set("loop_start", np.arange(0, count, 3, dtype=np.int32))
    mesh.polygons.foreach_set("material_index", material.astype(np.int32))
    for layer, values in (("texture", texture), (UV, uv)):
        mesh.uv_layers.new(name=layer)
        mesh.uv_layers[layer].data.foreach_set("uv", (values * (1, -1) + (0, 1)).astype(np.float32).ravel())
    mesh.uv_layers["texture"].active_render = True
    mesh.uv_layers.active = mesh.uv_layers[UV]
    for m in materials:
        mesh.materials.append(m)
    mesh.update()
    mesh.shade_flat()
    o = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(o)
    return o


def aim_at(o, image) -> None:
    """Makes `image` what a bake of the object writes to."""
    for slot in o.material_slots:
        slot.material = slot.material.copy()
        nodes = slot.material.node_tree.nodes
        node = nodes.new("ShaderNodeTexImage")
        node.image = image
        nodes.active = node


def light(sky: list[float] | None, sun_angle: float | None) -> None:
    if sky:
        world = bpy.data.worlds.new("sky")
        bpy.context.scene.world = world
        world.use_nodes = True
        background = next(n for n in world.node_tree.nodes if n.type == "BACKGROUND")
        background.inputs["Color"].default_value = (*sky, 1)
        background.inputs["Strength"].default_value = 1
    for o in bpy.data.lights:
        if o.type == "SUN":
            o.angle = math.radians(sun_angle or 0)


def main() -> None:
    ap = argparse.ArgumentParser()
    ap.add_argument("baked", type=Path)
    ap.add_argument("folder", type=Path)
    ap.add_argument("samples", type=int)
    ap.add_argument("--sky", type=lambda t: [float(v) for v in t.split(",")])
    ap.add_argument("--sun-angle", type=float)
    ap.add_argument("--threads", type=int)
    a = ap.parse_args()
    # Candela and lux as they stand, so that radiance is in nit.
    path_tracer.open_scene(a.baked, export_import_convert_lighting_mode="COMPAT")
    light(a.sky, a.sun_angle)
    objects = meshes(a.baked)
    for material in bpy.data.materials:
        make_diffuse(material)
    path_tracer.exact(a.samples)
    if a.threads:
        bpy.context.scene.render.threads_mode, bpy.context.scene.render.threads = "FIXED", a.threads
    pages = path_tracer.pages_of(a.baked)
    a.folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(a.baked, a.folder / a.baked.name)
    wall = cpu = 0.0
    for number, o in objects.items():
        if number < 0:
            continue
        page = pages[number]
        image = bpy.data.images.new(f"page{number}", page["width"], page["height"], float_buffer=True, is_data=True)
        aim_at(o, image)
        bpy.ops.object.select_all(action="DESELECT")
        o.select_set(True)
        bpy.context.view_layer.objects.active = o
        start, used = time.monotonic(), time.process_time()
        bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT", "INDIRECT"}, margin=MARGIN, margin_type="EXTEND", use_clear=True)
        wall, cpu = wall + time.monotonic() - start, cpu + time.process_time() - used
        file = a.folder / page["uri"]
        file.parent.mkdir(parents=True, exist_ok=True)
        image.filepath_raw, image.file_format = str(file), "OPEN_EXR"
        image.save()
    print(json.dumps({"bake_wall_s": wall, "bake_cpu_s": cpu, "version": bpy.app.version_string}))


main()
