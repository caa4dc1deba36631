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
from floor import look_down, open_white


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


def main() -> None:
    folder, samples, *names = sys.argv[1:]
    for name in names:
        stem, radiance, radius = name.split(":")
        open_white(Path(folder) / f"{stem}.usda")
        for thing in bpy.context.scene.objects:
            if thing.type == "LIGHT":
                undo_importer(thing, float(radiance), float(radius))
        look_down(Path(folder) / f"{stem}.exr", int(samples))
    print(json.dumps({"rendered": len(names)}))


main()
