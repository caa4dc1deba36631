"""A stage's geometry in white under lights, seen straight from above: the floor of 2 x 2 m around the origin, direct light alone."""

from pathlib import Path

import bpy

# Pixels along each side of the picture.
SIZE = 64


def open_white(path: Path, sky: bool = False) -> None:
    """An empty file with a USD stage in it, all of its meshes white. The importer reads domes where there is a world already: `sky`."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if sky:
        bpy.context.scene.world = bpy.data.worlds.new("sky")
    bpy.ops.wm.usd_import(filepath=str(path), create_world_material=sky)
    white = bpy.data.materials.new("white")
    white.use_nodes = True
    white.node_tree.nodes.clear()
    shader, output = white.node_tree.nodes.new("ShaderNodeBsdfDiffuse"), white.node_tree.nodes.new("ShaderNodeOutputMaterial")
    shader.inputs["Color"].default_value = (1, 1, 1, 1)
    white.node_tree.links.new(shader.outputs[0], output.inputs["Surface"])
    for thing in bpy.context.scene.objects:
        if thing.type == "MESH":
            thing.data.materials.clear()
            thing.data.materials.append(white)


def look_down(out: Path, samples: int) -> None:
    """Writes radiance by place to an EXR: +X to the right, -Z of the stage (+Y here) up."""
    scene = bpy.context.scene
    camera = bpy.data.cameras.new("camera")
    camera.type, camera.ortho_scale = "ORTHO", 2.0
    holder = bpy.data.objects.new("camera", camera)
    holder.location = (0, 0, 50)
    scene.collection.objects.link(holder)
    scene.camera = holder
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.use_adaptive_sampling = samples, False, False
    scene.cycles.max_bounces = scene.cycles.diffuse_bounces = 0
    scene.cycles.sample_clamp_direct = scene.cycles.sample_clamp_indirect = 0
    scene.cycles.pixel_filter_type = "BOX"
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = str(out)
    bpy.ops.render.render(write_still=True)
