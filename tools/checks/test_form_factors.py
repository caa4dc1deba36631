"""`lumel form-factors` writes what NumPy reads without pickle, and the form factors of a cube."""

import json
import struct

import numpy as np
import pytest
from conftest import SAMPLES, lumel

# Opposed and adjacent sides of a cube: C-11 and C-14 of Howell's catalogue.
OPPOSED, ADJACENT = 0.199825, 0.200044


def cube(path):
    """A unit cube seen from inside, a surface for each side; sides 2 k and 2 k + 1 are opposed."""
    x, y, z, o = np.eye(3)[0], np.eye(3)[1], np.eye(3)[2], np.zeros(3)
    quads = [(o, z, x), (y, x, z), (o, y, z), (x, z, y), (o, x, y), (z, y, x)]
    indices = struct.pack("<6H", 0, 1, 2, 0, 2, 3)
    corners = [np.float32([c, c + u, c + u + v, c + v]) for c, u, v in quads]
    path.with_suffix(".bin").write_bytes(indices + b"".join(c.tobytes() for c in corners))
    views = [{"buffer": 0, "byteLength": 12}] + [{"buffer": 0, "byteOffset": 12 + 48 * k, "byteLength": 48} for k in range(6)]
    accessors = [{"bufferView": 0, "componentType": 5123, "count": 6, "type": "SCALAR"}]
    for k, c in enumerate(corners):
        bounds = {"min": c.min(0).tolist(), "max": c.max(0).tolist()}
        accessors.append({"bufferView": k + 1, "componentType": 5126, "count": 4, "type": "VEC3", **bounds})
    gltf = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": list(range(6))}],
        "nodes": [{"name": f"Wand {k} ä", "mesh": k} for k in range(6)],
        "meshes": [{"primitives": [{"attributes": {"POSITION": k + 1}, "indices": 0}]} for k in range(6)],
        "buffers": [{"byteLength": 12 + 288, "uri": path.with_suffix(".bin").name}],
        "bufferViews": views,
        "accessors": accessors,
    }
    path.write_text(json.dumps(gltf))


def form_factors(scene, output, *arguments):
    run = lumel("form-factors", scene, "-o", output, *arguments)
    assert run.returncode == 0, run.stderr[-3000:]
    with np.load(output, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


@pytest.mark.parametrize("method, tolerance", [("area", 2e-3), ("analytic", 1e-3), ("hemicube", 1e-2), ("hemisphere", 1e-2)])
def test_a_cube_has_its_closed_forms(method, tolerance, tmp_path):
    cube(tmp_path / "cube.gltf")
    f = form_factors(tmp_path / "cube.gltf", tmp_path / "cube.npz", "--form-factors", method)
    assert f["method"] == method and list(f["surface_names"]) == [f"Wand {k} ä" for k in range(6)]
    n = len(f["area"])
    assert f["form_factors"].shape == (n, n) and f["back"].dtype == bool and not f["back"].any()
    side = np.arange(6)
    exact = np.where(side[:, None] // 2 == side // 2, OPPOSED, ADJACENT) * (side[:, None] != side)
    np.testing.assert_allclose(f["surface_form_factors"], exact, rtol=tolerance, atol=1e-12)
    # The same from the elements.
    members = f["surface"][:, None] == side
    sums = members.T @ (f["area"][:, None] * f["form_factors"].astype(float)) @ members
    np.testing.assert_allclose(sums / f["surface_area"][:, None], f["surface_form_factors"], rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(f["form_factors"].sum(1, dtype=float), f["closure"], rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(f["normal"], axis=1), 1, atol=1e-5)
    if method == "area":
        np.testing.assert_allclose(f["closure"] * f["scale"], f["landed"], rtol=1e-6)


def test_methods_that_see_occluders_agree_on_a_scene(tmp_path):
    scene = SAMPLES / "cornell_box/cornell_box.glb"
    by = {m: form_factors(scene, tmp_path / f"{m}.npz", "--quality", "draft", "--form-factors", m) for m in ("area", "hemicube")}
    a, b = (by[m]["surface_form_factors"] for m in by)
    assert abs(a - b).max() < 0.01
    assert abs(by["area"]["closure"] - by["area"]["landed"]).max() < 0.05
    assert by["area"]["reciprocity_error"] < 1e-6
