"""One room after 1, 2, 24 and 100 iterations: progressive refinement with and without the ambient term, and Gauss-Seidel."""

from dataclasses import dataclass

from .scenes import table as room
from .workbench import Bake, Workbench, page_error, reference_text, shown, table

STEPS = (1, 2, 24, 100)
METHODS = {
    "progressive": ["--solver", "progressive"],
    "ambient": ["--solver", "progressive", "--ambient"],
    "gauss_seidel": ["--solver", "gauss-seidel"],
}


@dataclass
class Size:
    """Texels a metre and elements of the room; the reference's samples."""

    density: float
    elements: int
    samples: int


FULL = Size(12, 2000, 1024)
LIGHT = Size(5, 400, 256)


def patches(bench: Workbench, size: Size, *options) -> Bake:
    scene = bench.work / "table.glb"
    return bench.bake(scene, "--density", size.density, "--elements", size.elements, "--gather", "none", *options)


def after(bench: Workbench, size: Size, method: str, step: int) -> Bake:
    return patches(bench, size, *METHODS[method], "--iterations", step)


def references(bench: Workbench, size: Size) -> tuple[Bake, Bake]:
    """The same elements until they have converged; and the room itself."""
    fine = bench.reference(bench.work / "table.glb", size.density, size.samples)
    return patches(bench, size, "--solver", "gauss-seidel"), fine


def measure(bench: Workbench, size: Size) -> tuple[dict, dict]:
    bench.write(room.scene())
    converged, fine = references(bench, size)
    out: dict = {"elements": converged.solver["elements"], "sweeps": converged.solver["iterations"]}
    for method in METHODS:
        out[method] = {}
        for step in STEPS:
            bake = after(bench, size, method, step)
            out[method][f"{step}"] = page_error(bake.pages(), converged.pages())["rms"]
    # As many shots as a sweep has rows: the same work.
    equal = patches(bench, size, "--solver", "progressive", "--iterations", out["elements"])
    out["progressive"]["equal_work"] = page_error(equal.pages(), converged.pages())["rms"]
    out["reference_bias"] = bench.reference_bias(bench.work / "table.glb", size.density, size.samples)
    out["converged_against_reference"] = page_error(converged.pages(), fine.pages())
    cost = {m: after(bench, size, m, STEPS[-1]).seconds("solve") for m in METHODS}
    return out, {"solve_100": cost}


def page(bench: Workbench, size: Size, numbers: dict, measured: dict) -> str:
    small = (240, 180)
    converged, fine = references(bench, size)
    exposure = bench.picture("converged", converged, small, flat=True)
    bench.picture("reference", fine, small, exposure=exposure)
    for method in METHODS:
        for step in STEPS:
            bench.picture(f"{method}_{step}", after(bench, size, method, step), small, flat=True, exposure=exposure)
    titles = {"progressive": "progressive", "ambient": "progressive, ambient term", "gauss_seidel": "Gauss-Seidel"}
    gallery = [[titles[m], *(shown(f"{m}_{s}", f"{titles[m]}, {s}") for s in STEPS)] for m in METHODS]
    rows = [[titles[m], *(numbers[m][f"{s}"] for s in STEPS), measured["solve_100"][m]["cpu"]] for m in METHODS]
    n = numbers["elements"]
    return f"""# Convergence

{table(["", *(f"{s}" for s in STEPS)], gallery)}
| converged | reference |
|---|---|
| {shown("converged", "converged")} | {shown("reference", "reference")} |

Cohen, Chen, Wallace and Greenberg, "A Progressive Refinement Approach to Fast Radiosity Image Generation" (SIGGRAPH 1988),
compared the two at 1, 2, 24 and 100 steps. Here one iteration of progressive refinement is a shot: one column of form factors,
from the element that has most to give. One of Gauss-Seidel is a sweep: a row for each of the {n} elements. Both begin with the
lamp's own light, which is sampled for each element before the first iteration.

**Scene.** The room of [table](../table), {n} elements.

    lumel bake table.glb --density {size.density:g} --elements {size.elements} --gather none --solver progressive --ambient --iterations 24

**Error** against the same elements when they have converged, RMS over the mean, per cent; and what 100 iterations cost.

{table(["iterations", *(f"{s}" for s in STEPS), "solve [CPU s]"], rows)}
After {n} shots, the work of a single sweep, progressive refinement is at {numbers["progressive"]["equal_work"]:.2g} %; one sweep
at {numbers["gauss_seidel"]["1"]:.2g} %. The ambient term spreads what has not been shot yet over all surfaces by their area and
the room's mean albedo: from the first shot the room looks as bright as it will be, while the light is still in the wrong places
(no colour from the wall, no shade below the table). It fades by itself, for it is proportional to the unshot light.

Converged, the elements themselves are {numbers["converged_against_reference"]["rms"]:.2g} % off the reference ({reference_text(numbers)}):
no number of iterations mends a mesh. Gauss-Seidel had converged after {numbers["sweeps"]} sweeps, and stopped there. Times: {measured["cores"]} cores, {measured["date"]}.
"""
