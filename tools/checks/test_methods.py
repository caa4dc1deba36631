"""Solvers, form factors and the path tracer, against reference values and against each other on the samples."""

import numpy as np
import OpenEXR
import pytest
from baked import triangles
from baked.energy import points
from baked.pages import read_page
from conftest import SAMPLES
from test_reference import figures

SMALL = ("--resolution", "64", "--normals", "geometric")


@pytest.mark.parametrize("solver", ["full-matrix", "jacobi", "gauss-seidel", "progressive", "hierarchical"])
def test_solvers_on_the_reference_cornell_box(solver, bake, reference):
    f = figures(bake, reference, "cornell_box", "--quality", "draft", *SMALL, "--solver", solver)
    assert f["unmapped"] == 0 and abs(f["bias"]) <= 0.015, f


@pytest.mark.parametrize("factors", ["area", "hemicube", "hemisphere"])
def test_form_factors_on_the_reference_cornell_box(factors, bake, reference):
    f = figures(bake, reference, "cornell_box", "--quality", "draft", *SMALL, "--form-factors", factors)
    assert f["unmapped"] == 0 and abs(f["bias"]) <= 0.03, f


def test_paths_on_the_reference_cornell_box(bake, reference):
    f = figures(bake, reference, "cornell_box", "--method", "path", "--samples", "256", *SMALL)
    assert f["unmapped"] == 0 and abs(f["bias"]) <= 0.01, f


def surface_means(glb) -> tuple[dict[str, float], dict[str, float]]:
    """Mean of the lightmap over each surface (luminance), and the share of the area that each has."""
    scene = triangles.load(glb)
    triangle, weights, _ = points(scene, 400_000)
    value = triangles.lightmap_at(scene, triangle, weights) @ [0.2126, 0.7152, 0.0722]
    node = scene.node[triangle]
    names = {n: scene.names[n] for n in np.unique(node)}
    return ({name: float(value[node == n].mean()) for n, name in names.items()}, {name: float((node == n).mean()) for n, name in names.items()})


@pytest.mark.parametrize("sample", ["cornell_box/cornell_box.glb", "furnace/furnace.glb", "sunroom/sunroom.usda"])
def test_surface_means_agree_with_paths(sample, bake):
    """Each surface within 1 %, and what four times the paths' own noise and three times that of blocks of 64 texels leave open."""
    settings = ("--resolution", "128", "--normals", "geometric")
    paths = bake(SAMPLES / sample, *settings, "--method", "path", "--samples", "512", "--layers", "error")
    solved = bake(SAMPLES / sample, *settings, "--quality", "medium")
    (truth, share), (means, _) = surface_means(paths.glb), surface_means(solved.glb)
    scene = triangles.load(paths.glb)
    for name, expected in truth.items():
        # Independent errors of texels: the mean of a surface errs by that of one over the root of their number.
        texels = max(share[name] * (scene.pages[0].coverage > 0).sum(), 1)
        blocks = 3 * solved.report["error"]["noise"] / 100 * np.sqrt(64 / texels)
        noise = np.hypot(4 * paths.report["noise"] / np.sqrt(texels), blocks) * np.mean(list(truth.values())) / expected
        off = means[name] / expected - 1
        print(f"{sample} {name}: {off:+.2%}, allowed 1 % and {noise:.2%}")
        assert abs(off) <= 0.01 + noise, f"{name}: {off:+.2%} with {noise:.2%} of noise"


@pytest.mark.parametrize("sample", ["cornell_box/cornell_box.glb", "furnace/furnace.glb", "sunroom/sunroom.usda"])
@pytest.mark.parametrize("method", [("--solver", "hierarchical"), ("--method", "path", "--samples", "64")])
def test_energy_closes_by_every_road(sample, method, bake):
    report = bake(SAMPLES / sample, "--quality", "draft", "--resolution", "128", "--normals", "geometric", *method).report
    assert abs(report["energy"]["imbalance"]) <= 0.005, report["energy"]


def test_layers_add_up_in_the_file(bake):
    done = bake(SAMPLES / "cornell_box/cornell_box.glb", "--quality", "draft", "--resolution", "64", "--layers", "direct,indirect,bounces", "--float")
    with OpenEXR.File(str(done.folder / "lightmaps/cornell_box_0.exr"), separate_channels=True) as f:
        channels = {name: np.asarray(c.pixels) for name, c in f.parts[0].channels.items()}
    layers = {name.rsplit(".", 1)[0] for name in channels if "." in name}
    bounces = {name for name in layers if name.startswith("bounce") or name == "rest"}
    assert {"emitted", "direct", "indirect", "bounce0", "bounce1", "bounce2", "rest"} <= layers
    for c in "RGB":
        assert np.allclose(sum(channels[f"{name}.{c}"] for name in bounces), channels[c], rtol=1e-4, atol=1e-4)
        assert np.allclose(channels[f"direct.{c}"] + channels[f"indirect.{c}"], channels[c], rtol=1e-4, atol=1e-4)


def test_watching_shows_the_light_come_up(bake, tmp_path):
    watched = tmp_path / "watch"
    done = bake(
        SAMPLES / "cornell_box/cornell_box.glb", "--quality", "draft", "--resolution", "64", "--solver", "jacobi", "--gather", "none", "--float", "--watch", watched, "--watch-every", "2",
        "--gutter", "padding",  # as what is watched has it
    )
    sweeps = done.report["solver"]["iterations"]
    names = sorted(p.name for p in watched.iterdir())
    assert names == sorted(f"{k:06}_0.{kind}" for k in range(2, sweeps + 1, 2) for kind in ("exr", "png"))
    means = [read_page(p).rgb.mean() for p in sorted(watched.glob("*.exr"))]
    assert all(b >= a for a, b in zip(means, means[1:])), means
    final = read_page(done.folder / "lightmaps/cornell_box_0.exr").rgb.mean()
    assert means[-1] == pytest.approx(final, rel=0.01)
    steps = done.report["solver"]["steps"]
    assert [s["iteration"] for s in steps] == list(range(1, sweeps + 1))


def test_analytic_form_factors_warn_of_what_stands_in_the_way(bake):
    settings = ("--quality", "draft", "--resolution", "64", "--form-factors", "analytic")
    said = "know no occluders"
    blocked = bake(SAMPLES / "cornell_box/cornell_box.glb", *settings)
    assert said in blocked.stderr
    assert said not in bake(SAMPLES / "furnace/furnace.glb", *settings).stderr
