"""Real scenes load, bake and give files that other software accepts."""

import json
from collections import Counter

import numpy as np
import pytest
from baked import triangles
from baked.display import LUMINANCE
from pxr import Usd, UsdUtils

# What each scene needs to be lit.
SKY = ("--sky", "1,1,1")
SCENES = {
    "bevy_cornell_box": (),
    "godot_living_room": SKY,
    "godot_gi_zdm2": SKY,
    "playcanvas_house": SKY,
    "nvpro_cornell_box": (),
    "usdwg_standard_shader_ball": (),
    "usdwg_teapot": SKY,
    "pablode_shoe_variants": (),
}


def complaints(layer) -> list[str]:
    """What usd-core says while it opens a stage, without the name of the stage itself."""
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    assert Usd.Stage.Open(str(layer))
    return [d.commentary.split(" (instantiating stage")[0] for d in delegate.TakeUncoalescedDiagnostics()]


@pytest.mark.parametrize("name", SCENES)
def test_real_scene_bakes(name, bake, reference, gltf_errors):
    folder = reference / "scenes"
    if not (folder / "MANIFEST.json").is_file():
        pytest.skip(f"no scenes in {folder}")
    entry = next(e for e in json.loads((folder / "MANIFEST.json").read_text()) if e["name"] == name)
    # Some folders were stored without the leading part of the path that the manifest names.
    scene = next(iter(sorted((folder / name).rglob(entry["main"][0].rsplit("/", 1)[-1]))))
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
        more = Counter(complaints(done.layer)) - Counter(complaints(scene))
        assert not more
