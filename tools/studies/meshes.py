"""Vertex colours of a table in a room: a uniform mesh, one that adapts, one along the discontinuities, at as many triangles each."""

from dataclasses import dataclass, replace
from math import ceil, dist

import numpy as np

from baked import camera, triangles
from baked.energy import points
from baked.raycast import Caster
from sample_scenes.model import Builder, Scene

from .scenes import table as room
from .table import ARTEFACTS
from .workbench import Bake, Workbench, buried, error, reference_text, shown, significant, table


@dataclass
class Size:
    """Triangles; texels a metre and samples of the light that they are to hold, which is the reference."""

    counts: tuple[int, ...]
    reference: tuple[float, int]


FULL = Size((1000, 2000), (80.0, 256))
LIGHT = Size((1500,), (24.0, 128))
KINDS = ("uniform", "adaptive", "discontinuity")
TITLES = {"uniform": "uniform", "adaptive": "adaptive", "discontinuity": "discontinuity, adaptive"}
# A point is at a shadow's edge where light differs by this part of its mean from 1.5 cm on one side to 1.5 cm on the other.
EDGE, REACH = 0.15, 0.015
POINTS = 150_000


def uniform(scene: Scene, count: int) -> Scene:
    """The scene with all faces, which have four corners, as grids of squares of one size: `count` triangles at most."""

    def cells(face: list, side: float) -> tuple[int, int]:
        a, b, c, d = face
        return max(1, ceil(max(dist(a, b), dist(d, c)) / side - 1e-9)), max(1, ceil(max(dist(b, c), dist(a, d)) / side - 1e-9))

    faces = [[m.points[i] for i in f] for m in scene.meshes for f in m.faces]
    total = lambda side: sum(2 * n * m for n, m in (cells(f, side) for f in faces))
    low, high = 1e-3, 10.0
    for _ in range(60):
        middle = (low * high) ** 0.5
        low, high = (low, middle) if total(middle) <= count else (middle, high)
    meshes = []
    for mesh in scene.meshes:
        fine = Builder(mesh.name, mesh.material)
        for face in mesh.faces:
            a, b, c, d = (np.array(mesh.points[i], float) for i in face)
            n, m = cells([a, b, c, d], high)
            at = lambda i, k: tuple(np.round((a * (n - i) + b * i) / n * (1 - k / m) + (d * (n - i) + c * i) / n * (k / m), 6) + 0.0)
            for i in range(n):
                for k in range(m):
                    fine.face(at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1))
        meshes.append(replace(fine.mesh(), double_sided=mesh.double_sided))
    return Scene(f"{scene.name}_{count}", scene.comment, scene.materials, meshes, scene.camera)


def vertex_bake(bench: Workbench, size: Size, kind: str, count: int) -> Bake:
    density, samples = size.reference
    options = ["--density", density, "--quality", bench.reference_quality, "--samples", samples]
    if kind == "uniform":
        # Along the edges of things squares are smaller: some are left over.
        return bench.bake(bench.write(uniform(room.scene(), count)), *options, vertices=True)
    return bench.bake(bench.work / "table.glb", *options, "--mesh", kind, "--vertex-error", "0.1%", "--max-triangles", count, vertices=True)


class Truth:
    """The reference's light at places of other meshes of the scene."""

    def __init__(self, bake: Bake):
        self.triangles = triangles.load(bake.glb)
        self.caster = Caster(self.triangles)

    def at(self, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """RGB; NaN where the reference has no surface right there, or what it has lies inside a solid or against one."""
        t = self.triangles
        found, weights = self.caster.closest(position + 1e-3 * normal, -normal)
        out = np.full((len(position), 3), np.nan)
        hit = found >= 0
        hit[hit] = ~buried(t, found[hit], weights[hit])
        place = (t.position[found[hit]] * weights[hit][..., None]).sum(1)
        near = (np.linalg.norm(place - position[hit], axis=1) < 2e-3) & ~self.caster.hidden(found[hit], weights[hit])
        out[hit] = np.where(near[:, None], triangles.lightmap_at(t, found[hit], weights[hit]), np.nan)
        return out


def vertex_errors(bake: Bake, truth: Truth) -> dict:
    """The error of vertex colours at points spread evenly over all surfaces, and at those at edges of shadows."""
    t = triangles.load(bake.folder / f"{bake.name}.vertex.glb")
    triangle, weights, _ = points(t, POINTS)
    position = (t.position[triangle] * weights[..., None]).sum(1)
    normal = t.normals()[triangle]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    value = (t.irradiance[triangle] * weights[..., None]).sum(1)
    right = truth.at(position, normal)
    across = np.cross(normal, np.where(np.abs(normal[:, :1]) > 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]]))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    known = np.isfinite(right).all(1) & np.isfinite(value).all(1)
    mean = right[known].mean(0).mean()
    steps = [np.abs(truth.at(position + way * REACH, normal) - truth.at(position - way * REACH, normal)).mean(1) for way in (across, np.cross(normal, across))]
    edge = known & (np.nan_to_num(np.maximum(*steps)) > EDGE * mean)
    of_edges = error(value[edge], right[edge])
    # Over the mean of all light, as the other.
    factor = right[edge].mean(0).mean() / mean
    return {
        "triangles": len(t.position),
        "rms": error(value[known], right[known])["rms"],
        "edge_rms": significant(of_edges["rms"] * factor),
    }


def reference(bench: Workbench, size: Size) -> Bake:
    return bench.reference(bench.work / "table.glb", *size.reference)


def measure(bench: Workbench, size: Size) -> tuple[dict, dict]:
    bench.write(room.scene())
    truth = Truth(reference(bench, size))
    rows, seconds = {}, {}
    for count in size.counts:
        for kind in KINDS:
            bake = vertex_bake(bench, size, kind, count)
            rows[f"{kind} {count}"] = vertex_errors(bake, truth)
            seconds[f"{kind} {count}"] = bake.seconds("vertices")
    bias = bench.reference_bias(bench.work / "table.glb", *size.reference)
    return {"reference_bias": bias, "meshes": rows}, {"vertices": seconds}


def page(bench: Workbench, size: Size, numbers: dict, measured: dict) -> str:
    truth = reference(bench, size)
    small = (300, 225)
    exposure = bench.picture("reference", truth)
    few = size.counts[0]
    gallery = []
    for title, draw in (("colours", bench.picture), ("mesh", bench.wire_picture), ("error", None)):
        row = [title]
        for kind in KINDS:
            bake, name = bench.vertices(vertex_bake(bench, size, kind, few)), f"{title}_{kind}"
            if draw is None:
                bench.error_picture(name, bake, truth, small)
            else:
                draw(name, bake, small, exposure=exposure)
            row.append(shown(name, f"{title}, {TITLES[kind]}"))
        gallery.append(row)
    closeups = []
    for k, (name, what, eye, target, fov, _, _) in enumerate(ARTEFACTS):
        view = camera.Camera(np.array(eye), np.array(target), fov)
        row = [f"**{name}**"]
        for kind in KINDS:
            bake, picture = bench.vertices(vertex_bake(bench, size, kind, few)), f"artefact_{k + 1}_{kind}"
            bench.picture(picture, bake, (240, 180), exposure=exposure, view=view)
            seen = seen_error(bench, bake, truth, view)
            row.append(f"{shown(picture, f'{name}, {TITLES[kind]}')} {seen:.3g} %")
        bench.picture(f"artefact_{k + 1}_reference", truth, (240, 180), exposure=exposure, view=view)
        closeups.append([*row, shown(f"artefact_{k + 1}_reference", "reference")])
    rows = [
        [TITLES[key.split()[0]], r["triangles"], r["rms"], r["edge_rms"], measured["vertices"][key]["cpu"]] for key, r in numbers["meshes"].items()
    ]
    head = ["mesh", "triangles", "RMS", "RMS at edges", "vertices [CPU s]"]
    return f"""# Meshes that hold the light

{shown("reference", "reference")}

{table(["", *(TITLES[kind] for kind in KINDS)], gallery)}
Vertex colours, each at {few} triangles or a few less. Error images: blue darker, red brighter than the reference, full colour at 20 %.

    lumel bake table.glb --density {size.reference[0]:g} --gltf vertex --mesh discontinuity --max-triangles {few}

**Scene.** That of the [table](../table): a room of 4.0 x 2.6 x 3.4 m, one lamp of 0.2 x 0.2 m. The uniform mesh is one of squares,
about equal; all three hold the light of the reference, by least squares.

**Error** against the reference ({reference_text(numbers)} at {size.reference[0]:g} texels a metre), RMS over the mean light, per cent: at points
spread evenly over all surfaces, and at those of them where light changes by more than {100 * EDGE:g} % of its mean within {200 * REACH:g} cm, at
the edges of shadows:

{table(head, rows)}
**The five artefacts** of radiosity meshes, with the RMS of what each picture shows off the reference's, over its mean:

{table(["", *(TITLES[kind] for kind in KINDS), "reference"], closeups)}
A uniform mesh spends its triangles on bare walls. An adaptive one cuts across a penumbra where it happens to; one along the
discontinuities has the borders of umbra and penumbra as edges, so that what lies between them is smooth. (Heckbert, "Discontinuity
meshing for radiosity", 1992; Lischinski, Tampieri, Greenberg, "Discontinuity meshing for accurate radiosity", 1992.) Times:
{measured["cores"]} cores, {measured["date"]}.
"""


def seen_error(bench: Workbench, bake: Bake, truth: Bake, view) -> float:
    (a, covered), (b, _) = (bench.render(x, (240, 180), view=view) for x in (bake, truth))
    # Lamps are as they are.
    seen = (covered > 0.99) & (b.max(-1) < 20 * np.median(b))
    return error(a[seen], b[seen])["rms"]
