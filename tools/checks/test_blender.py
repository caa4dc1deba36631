"""Blender imports what a bake writes, and its path tracer sees the same picture that the lightmap shows."""

import numpy as np
import pytest
from baked import display
from baked.compare import agreement
from baked.gltf import Document
from baked.pages import read_page

SIZE, SAMPLES = 160, 256


@pytest.mark.parametrize("name", ["cornell_box.glb", "sunroom.usda"])
def test_engine_glb_arrives_with_lightmap_uvs(name, bake, blender):
    done = bake.sample(name)
    meshes = blender("list_imported.py", done.glb)["meshes"]
    placed = {n["name"] for n, _ in Document(done.glb).placed_nodes() if "mesh" in n}
    assert len(meshes) == len(placed)
    lit = {k: m for k, m in meshes.items() if m["lumel"]}
    assert len(lit) == len(meshes), f"no lumel extras on {sorted(set(meshes) - set(lit))}"
    for key, m in meshes.items():
        uvs = [u for u in m["uvs"] if u.startswith("UVMap")]
        assert uvs, f"{key}: {m['uvs']}"
        found = m["attributes"][uvs[-1]]
        assert -1e-6 <= found["min"] < found["max"] <= 1 + 1e-6


def test_second_uv_map_holds_the_lightmap(bake, blender):
    """TEXCOORD_1 arrives as `UVMap.001`: the floor of the sunroom has a texture in the first set."""
    meshes = blender("list_imported.py", bake.sample("sunroom.usda").glb)["meshes"]
    floor = next(m for k, m in meshes.items() if "floor" in k)
    assert floor["uvs"][:2] == ["UVMap", "UVMap.001"]


@pytest.mark.parametrize("name", ["cornell_box.glb", "sunroom.usda"])
def test_vertex_glb_arrives_with_colours(name, bake, blender):
    done = bake.sample(name)
    doc = Document(done.vertex_glb)
    largest = max(
        float(doc.accessor(p["attributes"]["_IRRADIANCE"]).max()) for m in doc.json["meshes"] for p in m["primitives"]
    )
    meshes = blender("list_imported.py", done.vertex_glb)["meshes"]
    seen = 0.0
    for key, m in meshes.items():
        assert "_IRRADIANCE" in m["attributes"], f"{key}: {sorted(m['attributes'])}"
        colors = [a for a in m["attributes"].values() if a["type"] in ("BYTE_COLOR", "FLOAT_COLOR")]
        assert colors, f"{key}: no colour attribute"
        seen = max(seen, m["attributes"]["_IRRADIANCE"]["max"])
    assert seen == pytest.approx(largest, rel=1e-5), "the attribute was clipped"


@pytest.mark.parametrize("name", ["cornell_box.usda", "furnace.usda", "sunroom.usda"])
def test_layer_arrives_with_uvs_and_colours(name, bake, blender):
    meshes = blender("list_imported.py", bake.sample(name).layer)["meshes"]
    assert meshes
    for key, m in meshes.items():
        assert "st1" in m["uvs"], f"{key}: {m['uvs']}"
    lit = [m["attributes"]["displayColor"] for m in meshes.values() if "displayColor" in m["attributes"]]
    assert lit and max(a["max"] for a in lit) > 0


def test_lightmap_and_path_tracer_show_the_same_picture(bake, blender, pictures):
    """The Cornell box from its lightmap against Cycles with 64 bounces: the mean difference stays below 3 %."""
    done = bake.sample("cornell_box.glb")
    baked, traced = pictures / "cornell_box_baked.exr", pictures / "cornell_box_cycles.exr"
    shown = blender("render_baked.py", done.glb, baked, SIZE, SIZE)
    assert shown["surfaces"] == 8
    blender("render_original.py", done.scene, traced, SIZE, SIZE, SAMPLES)
    a, b = read_page(baked).rgb, read_page(traced).rgb
    exposure = display.write_png(baked.with_suffix(".png"), a, None)
    display.write_png(traced.with_suffix(".png"), b, exposure)
    display.write_png(pictures / "cornell_box_difference_x10.png", np.abs(a - b) * 10, exposure)
    figures = agreement(a, b, brightest=2.0)
    print(f"{pictures}: {figures}")
    assert abs(figures["bias"]) < 0.01, figures
    assert figures["mean"] < 0.03, figures
    assert figures["rmse"] < 0.05, figures
