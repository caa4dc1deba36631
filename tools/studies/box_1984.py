"""The empty box of 1984: analytic form factors, the full matrix, held against closed forms."""

from dataclasses import dataclass

import numpy as np

from baked import triangles
from baked.energy import points

from . import exact
from .scenes import boxes
from .workbench import Bake, Workbench, error, page_error, reference_text, shown, surface_error, table


@dataclass
class Size:
    """Patches along an edge, for each row of the table; the reference's texels a metre and samples."""

    edges: tuple[int, ...]
    reference: tuple[int, int]


# Powers of two: halving the sides into elements then gives squares.
FULL = Size((8, 16), (40, 2048))
LIGHT = Size((8,), (32, 256))


def patches(bench: Workbench, scene, n: int, solver: str, factors: str, texels: int = 1) -> Bake:
    """n x n patches a side, each of `texels` x `texels`."""
    options = ["--solver", solver, "--form-factors", factors, "--elements", 6 * n * n, "--gather", "none"]
    return bench.bake(scene, "--density", n * texels, *options)


def against_closed_forms(bake: Bake, n: int) -> dict[str, float]:
    """The mean over each patch against the solution from closed forms."""
    scene = boxes.scene_1984()
    look = {m.name: m for m in scene.materials}
    albedo = {m.name: np.array(look[m.material].albedo) for m in scene.meshes}
    emission = {m.name: np.array(look[m.material].emission) for m in scene.meshes}
    truth = exact.cube(n, albedo, emission)
    t = triangles.load(bake.glb)
    t.flat = True
    triangle, weights, _ = points(t, 200_000)
    at = np.minimum((t.position[triangle] * weights[..., None]).sum(1) * n, n - 1e-6).astype(int)
    value = triangles.lightmap_at(t, triangle, weights)
    found, expected = [], []
    for side, axes in {"floor": (0, 2), "ceiling": (0, 2), "left": (1, 2), "right": (1, 2), "back": (0, 1), "front": (0, 1)}.items():
        here = t.node[triangle] == t.names.index(side)
        patch = at[here, axes[0]] * n + at[here, axes[1]]
        found.append(np.stack([np.bincount(patch, c) for c in value[here].T], 1) / np.bincount(patch)[:, None])
        expected.append(truth[side].reshape(-1, 3))
    return error(np.concatenate(found), np.concatenate(expected))


def measure(bench: Workbench, size: Size) -> tuple[dict, dict]:
    scene = bench.write(boxes.scene_1984())
    density, samples = size.reference
    reference = bench.reference(scene, density, samples)
    rows, seconds = {}, {}
    for n in size.edges:
        matrix = patches(bench, scene, n, "full-matrix", "analytic")
        assert matrix.report["texels"] == matrix.solver["elements"] == 6 * n * n, "a texel is not a patch"
        seconds[f"{n}"] = matrix.seconds("solve")
        rows[f"{n}"] = {
            "patches": matrix.solver["elements"],
            "analytic": against_closed_forms(patches(bench, scene, n, "full-matrix", "analytic", 4), n),
            "area_sampling": against_closed_forms(patches(bench, scene, n, "full-matrix", "area", 4), n),
            "progressive": page_error(patches(bench, scene, n, "progressive", "analytic").pages(), matrix.pages()),
            "flat": surface_error(matrix, reference, flat=True),
            "interpolated": surface_error(matrix, reference),
        }
    return {"by_edge": rows, "reference_bias": bench.reference_bias(scene, density, samples)}, {"solve_s": seconds}


def page(bench: Workbench, size: Size, numbers: dict, measured: dict) -> str:
    scene = bench.work / "box_1984.glb"
    square = (300, 300)
    coarse = patches(bench, scene, size.edges[0], "full-matrix", "analytic")
    exposure = bench.picture("patches", coarse, square, flat=True)
    bench.picture("interpolated", coarse, square, exposure=exposure)
    density, samples = size.reference
    reference = bench.reference(scene, density, samples)
    bench.picture("reference", reference, square, exposure=exposure)
    bench.error_picture("error", coarse, reference, square)
    rows = [
        [
            f"{n} x {n}",
            row["patches"],
            row["analytic"]["rms"],
            row["area_sampling"]["rms"],
            row["progressive"]["rms"],
            row["flat"]["rms"],
            row["interpolated"]["rms"],
            measured["solve_s"][n]["cpu"],
        ]
        for n, row in numbers["by_edge"].items()
    ]
    head = ["each side", "patches", "analytic", "area sampling", "progressive", "flat", "interpolated", "solve [CPU s]"]
    n = size.edges[0]
    return f"""# The box of 1984

| {n} x {n} patches a side | the same, interpolated | reference | error, full colour at 20 % |
|---|---|---|---|
| {shown("patches", "flat patches")} | {shown("interpolated", "interpolated")} | {shown("reference", "reference")} | {shown("error", "error")} |

Goral, Torrance, Greenberg and Battaile, "Modeling the Interaction of Light Between Diffuse Surfaces" (SIGGRAPH 1984), brought
radiosity to pictures with an empty cube: nothing stands in the way of anything, so form factors have closed forms, and the system
is small enough to be solved as one matrix.

**Scene.** A cube of 1 m; red left wall, blue right wall, white back (.75), grey floor and ceiling (.5). The open front is the
source: 10 nit, diffuse, black. The paper prints a picture and few numbers; sizes, reflectances, radiance and the number of patches
are ours. The camera looks in through the source's back.

    lumel bake box_1984.glb --density {n} --elements {6 * n * n} --form-factors analytic --solver full-matrix --gather none

**Numbers.** RMS over the mean, per cent. *Analytic* and *area sampling*: the mean over each patch, 4 x 4 texels for once, of the
full matrix with these form factors against a solution whose factors are the closed forms for parallel and perpendicular
rectangles, computed apart from the baker (`tools/studies/exact.py`). *Progressive*: shooting until it has converged,
against the matrix, both analytic. *Flat*, *interpolated*: the patches as they are and with bilinear filtering, against the reference ({reference_text(numbers)}).

{table(head, rows)}
Neither solver nor form factors limit the picture: the patches do. Twice as many along an edge halve the error of flat patches;
interpolation hides the steps, but leaves the edges, where light changes fastest, too bright: red in the error image.

Solve times: {measured["cores"]} cores, {measured["date"]}.
"""
