"""Real scenes load, bake and give files that other software accepts."""

import json
from collections import Counter

import numpy as np
import pytest
from baked import triangles
from baked.display import LUMINANCE
from pxr import Usd, UsdUtils

# Folder of the scene, and what it needs to be lit.
SCENES = {
    "bevy_cornell_box": (),
    "godot_living_room": ("--sky", "1,1,1"),
    "godot_gi_zdm2": ("--sky", "1,1,1"),
    "playcanvas_house": ("--sky", "1,1,1"),
    "nvpro_cornell_box": ("--sky", "1,1,1"),
    "usdwg_standard_shader_ball": ("--sky", "1,1,1"),
    "usdwg_teapot": ("--sky", "1,1,1"),
    "pablode_shoe_variants": ("--sky", "1,1,1"),
}


@pytest.mark.parametrize("name", SCENES)
def test_real_scene_bakes(name, bake, reference, gltf_errors):
    folder = reference / "scenes"
    if not (folder / "MANIFEST.json").is_file():
        pytest.skip(f"no scenes in {folder}")
    entry = next(e for e in json.loads((folder / "MANIFEST.json").read_text()) if e["name"] == name)
    scene = folder / name / entry["main"][0]
    done = bake(scene, "--quality", "draft", *SCENES[name])
    baked = triangles.load(done.glb)
    values = np.concatenate([p.rgb[p.coverage > 0] for p in baked.pages])
    assert np.isfinite(values).all()
    assert (values @ LUMINANCE > 0).mean() > 0.3, "most texels are black"
    before = Counter()
    if scene.suffix in (".glb", ".gltf"):
        before = Counter(e["code"] for e in gltf_errors(scene)[scene.name])
    for file, errors in gltf_errors(done.glb, done.vertex_glb).items():
        more = Counter(e["code"] for e in errors) - before
        assert not more, f"{file}: {more} {errors[:3]}"
    if scene.suffix.startswith(".usd"):
        delegate = UsdUtils.CoalescingDiagnosticDelegate()
        Usd.Stage.Open(str(scene))
        known = {d.commentary for d in delegate.TakeUncoalescedDiagnostics()}
        assert Usd.Stage.Open(str(done.layer))
        said = [d.commentary for d in delegate.TakeUncoalescedDiagnostics() if d.commentary not in known]
        assert said == []
