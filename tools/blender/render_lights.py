"""render_lights.py FOLDER SAMPLES NAME ...: Cycles looks straight down at the floor of FOLDER/NAME.usda (2 x 2 m, white, direct light
alone) and writes FOLDER/NAME.exr: radiance by place, +X to the right, -Z of the stage (+Y here) up. What Blender's importer does to
lights that the file doesn't say is undone: suns come in four times as bright and twice as wide, balls 6 % dark.
"""

import json
import math
import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parent), str(Path(__file__).resolve().parent.parent)]
import bpy

SIZE = 64


def undo_importer(light, radiance: float, radius: float) -> None:
    data = light.data
    light.visible_camera = False
    if data.type == "SUN":
        data.energy /= 4
        data.angle /= 2
    elif data.type == "POINT":
        # A ball of radiance L has a power of 4 pi r^2 pi L, which is what Blender calls normalized.
        # Its soft falloff would make a disc of the ball.
        data.normalize, data.use_soft_falloff = True, False
        data.energy, data.color, data.shadow_soft_size = 4 * math.pi**2 * radius**2 * radiance, (1, 1, 1), radius


def render(path: Path, out: Path, samples: int, radiance: float, radius: float) -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.usd_import(filepath=str(path))
    scene = bpy.context.scene
    white = bpy.data.materials.new("white")
    white.use_nodes = True
    white.node_tree.nodes.clear()
    shader, output = white.node_tree.nodes.new("ShaderNodeBsdfDiffuse"), white.node_tree.nodes.new("ShaderNodeOutputMaterial")
    shader.inputs["Color"].default_value = (1, 1, 1, 1)
    white.node_tree.links.new(shader.outputs[0], output.inputs["Surface"])
    for thing in list(scene.objects):
        if thing.type == "MESH":
            thing.data.materials.clear()
            thing.data.materials.append(white)
        elif thing.type == "LIGHT":
            undo_importer(thing, radiance, radius)
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


def main() -> None:
    folder, samples, *names = sys.argv[1:]
    for name in names:
        stem, radiance, radius = name.split(":")
        render(Path(folder) / f"{stem}.usda", Path(folder) / f"{stem}.exr", int(samples), float(radiance), float(radius))
    print(json.dumps({"rendered": len(names)}))


main()
