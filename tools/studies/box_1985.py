"""The box of 1985: occluders, the hemicube, and beside it area sampling."""

from dataclasses import dataclass

from .scenes import boxes
from .workbench import Bake, Workbench, page_error, reference_text, shown, table


@dataclass
class Size:
    """Texels a metre (each is a patch), cells along the edge of the hemicube's top; the reference's samples."""

    density: float
    cells: tuple[int, ...]
    samples: int


FULL = Size(10, (8, 16, 32, 64, 128), 2048)
LIGHT = Size(5, (8, 16, 32), 256)
# Cells of the pictures of aliasing.
ALIASING = (8, 16, 32)


def patches(bench: Workbench, density: float, factors: str, *options) -> Bake:
    common = ["--elements", 100_000, "--gather", "none", "--solver", "gauss-seidel", "--form-factors", factors]
    return bench.bake(bench.work / "box_1985.glb", "--density", density, *common, *options)


def area_sampling(bench: Workbench, size: Size) -> Bake:
    return patches(bench, size.density, "area")


def reference(bench: Workbench, size: Size) -> Bake:
    return bench.reference(bench.work / "box_1985.glb", size.density, size.samples)


def measure(bench: Workbench, size: Size) -> tuple[dict, dict]:
    bench.write(boxes.scene_1985())
    area, truth = area_sampling(bench, size), reference(bench, size).pages()
    rows, seconds = {}, {"area": area.seconds("solve")}
    finest = patches(bench, size.density, "hemicube", "--hemicube", 2 * size.cells[-1])
    for n in size.cells:
        cube = patches(bench, size.density, "hemicube", "--hemicube", n)
        rows[f"{n}"] = {
            "against_finest": page_error(cube.pages(), finest.pages()),
            "against_area": page_error(cube.pages(), area.pages()),
            "against_reference": page_error(cube.pages(), truth),
        }
        seconds[f"{n}"] = cube.seconds("solve")
    return {
        "reference_bias": bench.reference_bias(bench.work / "box_1985.glb", size.density, size.samples),
        "patches": area.solver["elements"],
        "by_cells": rows,
        "area_against_reference": page_error(area.pages(), truth),
    }, {"solve": seconds}


def page(bench: Workbench, size: Size, numbers: dict, measured: dict) -> str:
    square = (300, 300)
    area, truth = area_sampling(bench, size), reference(bench, size)
    exposure = bench.picture("reference", truth, square)
    bench.picture("area", area, square, flat=True, exposure=exposure)
    few, many = size.cells[0], size.cells[-1]
    finest = patches(bench, size.density, "hemicube", "--hemicube", 2 * many)
    for n in size.cells:
        cube = patches(bench, size.density, "hemicube", "--hemicube", n)
        if n in (few, many):
            bench.picture(f"hemicube_{n}", cube, square, flat=True, exposure=exposure)
        if n in ALIASING:
            bench.error_picture(f"aliasing_{n}", cube, finest, square, percent=5, both_flat=True)
    bench.error_picture("points", finest, area, square, percent=5, both_flat=True)
    rows = [
        [f"hemicube, {n}", r["against_finest"]["rms"], r["against_area"]["rms"], r["against_reference"]["rms"], r["against_reference"]["bias"], measured["solve"][n]["cpu"]]
        for n, r in numbers["by_cells"].items()
    ]
    sampled = numbers["area_against_reference"]
    rows.append(["area sampling", "", "", sampled["rms"], sampled["bias"], measured["solve"]["area"]["cpu"]])
    head = ["form factors", f"RMS to {2 * size.cells[-1]} cells", "RMS to area sampling", "RMS to reference", "bias to reference", "solve [CPU s]"]
    return f"""# The box of 1985

| hemicube, {few} cells | hemicube, {many} cells | area sampling | reference |
|---|---|---|---|
| {shown(f"hemicube_{few}", "coarse hemicube")} | {shown(f"hemicube_{many}", "fine hemicube")} | {shown("area", "area sampling")} | {shown("reference", "reference")} |

Cohen and Greenberg, "The Hemi-Cube: A Radiosity Solution for Complex Environments" (SIGGRAPH 1985), put things into the box. A form
factor then asks what a patch sees: the hemicube draws the scene on the five sides of half a cube over the patch and adds up the
cells that each other patch covers. They took the patch's middle; here it is the mean over four points of it.

**Scene.** A cube of 1 m; red left, blue right, the rest white (.75); two white boxes; a source of 0.3 x 0.3 m, 30 nit. Sizes and
reflectances are ours. {numbers["patches"]} patches, each a texel, shown as they are.

    lumel bake box_1985.glb --density {size.density:g} --elements 100000 --gather none --solver gauss-seidel --form-factors hemicube --hemicube {many}

**Error.** RMS over the mean and bias, per cent, by the cells along the edge of the hemicube's top: against a hemicube of
{2 * size.cells[-1]} cells, against area sampling on the same patches, and against the reference ({reference_text(numbers)}), which
counts the size of the patches as well.

{table(head, rows)}
**Aliasing.** A patch covers a whole number of cells: one that is smaller than a cell is met or missed, by where it happens to lie.
What shows is not noise that more light would even out but a pattern, wrong the same way every time. Difference to
{2 * many} cells, patch by patch, full colour at 5 %; the last shows what cells don't mend, the finest hemicube against area sampling:

| {" | ".join(f"{n} cells" for n in ALIASING)} | four points of a patch |
|{"---|" * (len(ALIASING) + 1)}
| {" | ".join(shown(f"aliasing_{n}", f"aliasing, {n} cells") for n in ALIASING)} | {shown("points", "finest hemicube against area sampling")} |

Four points stand for a patch, whatever the resolution: where patches meet in a corner, by the lamp and at the foot of the boxes,
they don't see what all of the patch sees, and the hemicube stays wrong. The lamp's own light is sampled at the texels in all rows; what differs is the light between
patches. Times: {measured["cores"]} cores, {measured["date"]}.
"""
