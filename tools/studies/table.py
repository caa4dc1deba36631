"""A table in a room: a uniform mesh at three densities, its error, and the five artefacts of meshing."""

from dataclasses import dataclass

import numpy as np

from baked import camera

from .scenes import table as room
from .workbench import Bake, Workbench, reference_text, shown, surface_error, table


@dataclass
class Size:
    """Texels a metre (each is a patch) of each mesh; the reference's texels a metre and samples."""

    densities: tuple[float, ...]
    reference: tuple[float, int]


FULL = Size((2.5, 5.0, 10.0), (40.0, 512))
LIGHT = Size((1.5, 3.0, 4.5), (12.0, 128))

# Where each artefact shows: name, eye, target, vertical angle, the mesh's index among the densities, patches as they are.
ARTEFACTS = [
    ("blocky shadows", "the table's shadow on the floor follows the patches in steps", (3.3, 1.5, 3.0), (1.9, 0.0, 1.4), 36, 1, True),
    ("missing features", "the shelf throws no shadow on the wall", (2.9, 1.4, 2.6), (1.6, 1.35, 0.0), 40, 0, False),
    (
        "Mach bands",
        "interpolation is straight between patches and has a kink at each: lines along the shadow, a star above the shelf",
        (1.9, 1.6, 2.2),
        (1.35, 1.6, 0.0),
        42,
        1,
        False,
    ),
    (
        "inappropriate shading discontinuities",
        "the floor is two slabs, meshed apart: where the table's shadow crosses their joint, shading jumps",
        (1.95, 0.5, 1.5),
        (1.37, 0.0, 0.5),
        28,
        1,
        False,
    ),
    (
        "unresolved discontinuities",
        "the shelf meets the wall inside a patch: light leaks below it, shade above",
        (1.95, 1.15, 1.3),
        (1.6, 1.45, 0.0),
        34,
        1,
        False,
    ),
]


def patches(bench: Workbench, density: float) -> Bake:
    options = ["--quality", "draft", "--solver", "gauss-seidel", "--gather", "none", "--elements", 100_000]
    return bench.bake(bench.work / "table.glb", "--density", density, *options)


def reference(bench: Workbench, size: Size) -> Bake:
    density, samples = size.reference
    return bench.reference(bench.work / "table.glb", density, samples)


def measure(bench: Workbench, size: Size) -> tuple[dict, dict]:
    bench.write(room.scene())
    truth = reference(bench, size)
    rows, seconds = {}, {}
    for density in size.densities:
        bake = patches(bench, density)
        rows[f"{density:g}"] = {
            "patches": bake.solver["elements"],
            "flat": surface_error(bake, truth, flat=True),
            "interpolated": surface_error(bake, truth),
        }
        seconds[f"{density:g}"] = bake.seconds("direct", "solve")
    bias = bench.reference_bias(bench.work / "table.glb", *size.reference)
    return {"reference_bias": bias, "by_density": rows}, {"solve": seconds}


def page(bench: Workbench, size: Size, numbers: dict, measured: dict) -> str:
    truth = reference(bench, size)
    small = (300, 225)
    exposure = bench.picture("reference", truth)
    for density in size.densities:
        bake = patches(bench, density)
        bench.picture(f"flat_{density:g}", bake, small, exposure=exposure, flat=True)
        bench.picture(f"smooth_{density:g}", bake, small, exposure=exposure)
        bench.error_picture(f"error_{density:g}", bake, truth, small)
    gallery = [
        [title, *(shown(f"{kind}_{d:g}", f"{title}, {d:g} texels a metre") for d in size.densities)]
        for kind, title in (("flat", "patches"), ("smooth", "interpolated"), ("error", "error"))
    ]
    closeups = []
    for k, (name, what, eye, target, fov, mesh, flat) in enumerate(ARTEFACTS):
        view = camera.Camera(np.array(eye), np.array(target), fov)
        density = size.densities[mesh]
        bench.picture(f"artefact_{k + 1}", patches(bench, density), (240, 180), exposure=exposure, flat=flat, view=view)
        bench.picture(f"artefact_{k + 1}_reference", truth, (240, 180), exposure=exposure, view=view)
        text = f"**{name}**: {what} ({density:g} a metre)"
        closeups.append([text, shown(f"artefact_{k + 1}", name), shown(f"artefact_{k + 1}_reference", "reference")])
    rows = [
        [d, r["patches"], r["flat"]["rms"], r["interpolated"]["rms"], r["interpolated"]["bias"], measured["solve"][d]["cpu"]]
        for d, r in numbers["by_density"].items()
    ]
    head = ["texels a metre", "patches", "RMS, flat", "RMS, interpolated", "bias", "light and solve [CPU s]"]
    return f"""# Table in a room

{shown("reference", "reference")}

{table(["texels a metre", *(f"{d:g}" for d in size.densities)], gallery)}
A uniform mesh, the way radiosity began: every patch the same size, wherever the shadows lie. Each texel is a patch, and shows what
the patch has, without a final gather. Error images: blue darker, red brighter than the reference, full colour at 20 %.

    lumel bake table.glb --quality draft --density {size.densities[1]:g} --elements 100000 --gather none --solver gauss-seidel

**Scene.** A room of 4.0 x 2.6 x 3.4 m, one lamp of 0.2 x 0.2 m below the ceiling; table, stool, shelf, books, a box. The floor is
two slabs that meet at x = {room.SEAM} m, each with patches of its own.

**Error** against the reference ({reference_text(numbers)} at {size.reference[0]:g} texels a metre), RMS over the mean and bias, per cent:

{table(head, rows)}
**The five artefacts** of such meshes, each beside the reference:

{table(["", "mesh", "reference"], closeups)}
Shadow edges are where the error is, and there uniform refinement pays badly: twice the density is four times the patches. (Cohen,
Wallace, "Radiosity and Realistic Image Synthesis", 1993, chapters 6 and 8.) Times: {measured["cores"]} cores, {measured["date"]}.
"""
