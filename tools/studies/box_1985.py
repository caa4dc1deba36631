"""The box of 1985: occluders, the hemicube, and beside it area sampling."""

from dataclasses import dataclass

from .scenes import boxes
from .workbench import REFERENCE_TEXT, Bake, Workbench, page_error, shown, table


@dataclass
class Size:
    """Texels a metre (each is a patch), cells along the edge of the hemicube's top; the reference's samples."""

    density: float
    cells: tuple[int, ...]
    samples: int


FULL = Size(16, (8, 16, 32, 64, 128, 256), 2048)
LIGHT = Size(8, (8, 32, 128), 512)


def patches(bench: Workbench, density: float, factors: str, *options) -> Bake:
    common = ["--elements", 100_000, "--gather", "none", "--solver", "gauss-seidel", "--form-factors", factors]
    return bench.bake(bench.work / "box_1985.glb", "--density", density, *common, *options)


def area_sampling(bench: Workbench, size: Size) -> Bake:
    return patches(bench, size.density, "area", "--quality", "high")


def reference(bench: Workbench, size: Size) -> Bake:
    return bench.reference(bench.work / "box_1985.glb", size.density, size.samples)


def measure(bench: Workbench, size: Size) -> tuple[dict, dict]:
    bench.write(boxes.scene_1985())
    area, truth = area_sampling(bench, size), reference(bench, size).pages()
    rows, seconds = {}, {"area": area.seconds("solve")}
    for n in size.cells:
        cube = patches(bench, size.density, "hemicube", "--hemicube", n)
        rows[f"{n}"] = {"against_area": page_error(cube.pages(), area.pages()), "against_reference": page_error(cube.pages(), truth)}
        seconds[f"{n}"] = cube.seconds("solve")
    return {
        "patches": area.solver["elements"],
        "by_cells": rows,
        "area_against_reference": page_error(area.pages(), truth),
    }, {"solve": seconds}


def page(bench: Workbench, size: Size, numbers: dict, measured: dict) -> str:
    square = (300, 300)
    area, truth = area_sampling(bench, size), reference(bench, size)
    exposure = bench.picture("reference", truth, square)
    bench.picture("area", area, square, flat=True, exposure=exposure)
    few, many = size.cells[0], size.cells[3]
    for n in (few, many):
        cube = patches(bench, size.density, "hemicube", "--hemicube", n)
        bench.picture(f"hemicube_{n}", cube, square, flat=True, exposure=exposure)
        bench.error_picture(f"aliasing_{n}", cube, area, square, percent=10, flat=True)
    rows = [
        [f"hemicube, {n}", r["against_area"]["rms"], r["against_reference"]["rms"], r["against_reference"]["bias"], measured["solve"][n]["cpu"]]
        for n, r in numbers["by_cells"].items()
    ]
    sampled = numbers["area_against_reference"]
    rows.append(["area sampling", "", sampled["rms"], sampled["bias"], measured["solve"]["area"]["cpu"]])
    head = ["form factors", "RMS to area sampling", "RMS to reference", "bias to reference", "solve [CPU s]"]
    return f"""# The box of 1985

| hemicube, {few} cells | hemicube, {many} cells | area sampling | reference |
|---|---|---|---|
| {shown(f"hemicube_{few}", "coarse hemicube")} | {shown(f"hemicube_{many}", "fine hemicube")} | {shown("area", "area sampling")} | {shown("reference", "reference")} |

Cohen and Greenberg, "The Hemi-Cube: A Radiosity Solution for Complex Environments" (SIGGRAPH 1985), put things into the box. A form
factor then asks what a patch sees: the hemicube draws the scene on the five sides of half a cube over the patch's middle and adds
up the cells that each other patch covers.

**Scene.** A cube of 1 m; red left, blue right, the rest white (.75); two white boxes; a source of 0.3 x 0.3 m, 30 nit. Sizes and
reflectances are ours. {numbers["patches"]} patches, each a texel, shown as they are.

    lumel bake box_1985.glb --density {size.density:g} --elements 100000 --gather none --solver gauss-seidel --form-factors hemicube --hemicube {many}

**Error.** RMS over the mean and bias, per cent, by the cells along the edge of the hemicube's top: against the same patches with
area sampling (`--quality high`), and against the reference ({REFERENCE_TEXT}), which counts the size of the patches as well.

{table(head, rows)}
**Aliasing.** A patch covers a whole number of cells: one that is smaller than a cell is met or missed, by where it happens to lie.
What shows is not noise but a pattern, bands and speckles that repeat along walls. Difference to area sampling, full colour at 10 %:

| {few} cells | {many} cells |
|---|---|
| {shown(f"aliasing_{few}", "aliasing, coarse")} | {shown(f"aliasing_{many}", "aliasing, fine")} |

More cells make it finer and weaker. The middle of a patch stands for all of it besides, whatever the resolution: where two patches
meet in a corner, the hemicube stays wrong. Times: {measured["cores"]} cores, {measured["date"]}.
"""
