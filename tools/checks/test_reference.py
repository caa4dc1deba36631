"""Agreement with converged reference values, measured by the reference folder's own tool."""

import json
import subprocess
import sys

import pytest


def figures(bake, reference, name: str, *arguments) -> dict:
    folder = reference / "reference" / name
    done = bake(folder / "scene.glb", *arguments)
    tool = reference / "tools" / "lightmap_error.py"
    run = subprocess.run([sys.executable, tool, done.glb, folder / "points.npz", "--json"], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    result = json.loads(run.stdout)
    print(name, {k: round(v, 4) for k, v in result.items()})
    return result


def test_cornell_box_at_high_quality(bake, reference):
    f = figures(bake, reference, "cornell_box", "--quality", "high", "--resolution", "256", "--normals", "geometric")
    assert f["unmapped"] == 0, f
    assert abs(f["bias"]) <= 0.005, f
    assert f["rel_rmse_trim"] <= 0.025, f
    assert f["p50"] <= 0.015, f


@pytest.mark.slow
def test_living_room_at_high_quality(bake, reference):
    f = figures(bake, reference, "living_room", "--quality", "high", "--normals", "geometric")
    assert f["unmapped"] == 0, f
    assert abs(f["bias"]) <= 0.03, f
    assert f["p50"] <= 0.04, f
