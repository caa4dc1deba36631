"""Blender as the checks use it: an empty file, an import, diffuse materials, Cycles without shortcuts."""

import json
import struct
import urllib.parse
from pathlib import Path

import bpy


def open_scene(path: Path, **gltf_options) -> None:
    """An empty file with the scene of a .glb, .gltf or USD file in it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if path.suffix in (".glb", ".gltf"):
        bpy.ops.import_scene.gltf(filepath=str(path), **gltf_options)
    else:
        bpy.ops.wm.usd_import(filepath=str(path), import_all_materials=False)


def lumel_of(baked: Path) -> dict:
    """What the baker wrote about the whole file, from the header of the GLB: the importer drops the extras of `asset`."""
    data = baked.read_bytes()
    size = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20 : 20 + size])["asset"]["extras"]["lumel"]


def pages_of(baked: Path) -> list[dict]:
    """Size and file (`uri`, decoded) of each page."""
    return [p | {"uri": urllib.parse.unquote(p["uri"])} for p in lumel_of(baked)["pages"]]


def mesh_objects() -> list:
    return [o for o in bpy.data.objects if o.type == "MESH"]


def base_colour(material) -> tuple:
    """Colour factor and image of a material as imported, before it is changed."""
    if material is None or not material.use_nodes:
        return (0.8, 0.8, 0.8, 1.0), None, (0.0, 0.0, 0.0)
    for node in material.node_tree.nodes:
        if node.type == "BSDF_PRINCIPLED":
            socket = node.inputs["Base Color"]
            strength = node.inputs["Emission Strength"].default_value
            emission = tuple(v * strength for v in node.inputs["Emission Color"].default_value[:3])
            return tuple(socket.default_value), image_behind(socket), emission
    return (0.8, 0.8, 0.8, 1.0), None, (0.0, 0.0, 0.0)


def image_behind(socket):
    """The image that feeds a socket, directly or through a mix."""
    stack = [link.from_node for link in socket.links]
    while stack:
        node = stack.pop()
        if node.type == "TEX_IMAGE":
            return node.image
        stack += [link.from_node for i in node.inputs for link in i.links]
    return None


def fresh(material):
    """The node tree of a material, emptied, and its output."""
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    return tree, tree.nodes.new("ShaderNodeOutputMaterial")


def own_colour(material):
    """The node tree of a material as imported, a socket with its base colour, factor, texture and the texture's placement included,
    and its output."""
    found = [n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED"] if material.use_nodes else []
    if not found:
        tree, output = fresh(material)
        return tree, colour_node(tree, (0.8, 0.8, 0.8, 1.0), None), output
    tree, socket = material.node_tree, found[0].inputs["Base Color"]
    colour = socket.links[0].from_socket if socket.links else colour_node(tree, tuple(socket.default_value), None)
    return tree, colour, next(n for n in tree.nodes if n.type == "OUTPUT_MATERIAL")


def colour_node(tree, factor: tuple, image):
    """A socket with factor times image."""
    value = tree.nodes.new("ShaderNodeRGB")
    value.outputs[0].default_value = factor
    if image is None:
        return value.outputs[0]
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    return product(tree, texture.outputs["Color"], value.outputs[0])


def product(tree, a, b):
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = "MULTIPLY"
    tree.links.new(a, node.inputs[0])
    tree.links.new(b, node.inputs[1])
    return node.outputs["Vector"]


def total(tree, a, b):
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = "ADD"
    tree.links.new(a, node.inputs[0])
    tree.links.new(b, node.inputs[1])
    return node.outputs["Vector"]


def exact(samples: int) -> None:
    """Cycles on the CPU, 64 bounces, nothing clamped."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples = samples
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.max_bounces = cycles.diffuse_bounces = 64
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.blur_glossy = 0
    cycles.filter_width = 1.0


def render(width: int, height: int, samples: int, path: Path) -> None:
    """The view of the scene's camera, to a linear float EXR."""
    exact(samples)
    scene = bpy.context.scene
    if scene.camera is None:
        scene.camera = next(o for o in bpy.data.objects if o.type == "CAMERA")
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = width, height, 100
    scene.render.use_compositing = scene.render.use_sequencer = False
    scene.view_settings.view_transform = "Standard"
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
