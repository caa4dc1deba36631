"""Every GLB that a bake of a sample writes passes the Khronos validator, and holds what engines look for."""

import json

import numpy as np
import pytest
from baked import triangles
from baked.gltf import Document
from baked.energy import points
from baked.raycast import Caster
from conftest import SAMPLE_BAKES


@pytest.mark.parametrize("name", SAMPLE_BAKES)
def test_validator_finds_no_error(name, bake, gltf_errors):
    done = bake.sample(name)
    found = gltf_errors(done.glb, done.vertex_glb)
    assert found == {done.glb.name: [], done.vertex_glb.name: []}


@pytest.mark.parametrize("name", SAMPLE_BAKES)
def test_every_surface_has_its_place_on_a_page(name, bake):
    scene = triangles.load(bake.sample(name).glb)
    assert scene.lumel["quantity"] == "outgoing" and scene.lumel["unit"] == "nit"
    assert (scene.page >= 0).all(), f"no lightmap: {sorted({scene.names[n] for n in scene.node[scene.page < 0]})}"
    assert scene.page_uv.min() >= 0 and scene.page_uv.max() <= 1
    # The centre of every triangle lies on a covered texel, and none is shared by two surfaces.
    centre = scene.page_uv.mean(1)
    for page in range(len(scene.pages)):
        at = scene.page == page
        height, width = scene.pages[page].coverage.shape
        x = np.clip((centre[at, 0] * width).astype(int), 0, width - 1)
        y = np.clip((centre[at, 1] * height).astype(int), 0, height - 1)
        assert (scene.pages[page].coverage[y, x] > 0).all()


def test_charts_do_not_overlap(bake):
    """Points spread over every triangle fall on texels of their own: no texel belongs to two surfaces."""
    scene = triangles.load(bake.sample("cornell_box.glb").glb)
    rng = np.random.default_rng(1)
    count = 400
    u, v = rng.random((2, len(scene.page), count))
    flip = u + v > 1
    u, v = np.where(flip, 1 - u, u), np.where(flip, 1 - v, v)
    weights = np.stack([1 - u - v, u, v], -1)
    uv = (weights[..., None] * scene.page_uv[:, None]).sum(2)
    height, width = scene.pages[0].coverage.shape
    texel = (uv[..., 1] * height).astype(int) * width + (uv[..., 0] * width).astype(int)
    owner: dict[int, int] = {}
    for t in range(len(scene.page)):
        for k in np.unique(texel[t]):
            assert owner.setdefault(int(k), int(scene.node[t])) == scene.node[t], f"texel {k} belongs to two surfaces"


@pytest.mark.parametrize("name", ["cornell_box.glb"])
def test_what_the_baker_did_not_touch_stays(name, bake):
    done = bake.sample(name)
    before, after = Document(done.scene).json, Document(done.glb).json
    for key in ("materials", "cameras", "scenes", "scene", "extensionsUsed"):
        assert after.get(key) == before.get(key), key
    assert [n.get("name") for n in after["nodes"]] == [n.get("name") for n in before["nodes"]]
    assert after["asset"]["copyright"] == before["asset"]["copyright"]


@pytest.mark.parametrize("name", ["cornell_box.glb", "sunroom.usda"])
def test_vertex_colours_agree_with_the_lightmap(name, bake):
    """`_IRRADIANCE` holds the full range, COLOR_0 times the file's scale the same; each surface has the mean light of its page."""
    done = bake.sample(name)
    doc = Document(done.vertex_glb)
    scale = doc.lumel()["vertexScale"]
    assert "KHR_materials_unlit" in doc.json["extensionsUsed"]
    worst = 0.0
    for mesh in doc.json["meshes"]:
        for primitive in mesh["primitives"]:
            assert {"COLOR_0", "_IRRADIANCE"} <= set(primitive["attributes"]), json.dumps(primitive["attributes"])
            color = doc.accessor(primitive["attributes"]["COLOR_0"])[:, :3]
            assert color.min() >= 0 and color.max() <= 1
            worst = max(worst, float(color.max()))
            assert np.isfinite(doc.accessor(primitive["attributes"]["_IRRADIANCE"])).all()
    assert scale > 0 and worst > 0.5, f"the largest COLOR_0 is {worst}: the scale wastes range"
    engine, vertex = triangles.load(done.glb), triangles.load(done.vertex_glb)
    assert len(engine.page) == len(vertex.page)
    triangle, weights, _ = points(engine, 100_000)
    seen = ~Caster(engine).hidden(triangle, weights)
    triangle, weights = triangle[seen], weights[seen]
    page = triangles.lightmap_at(engine, triangle, weights)
    shown = (vertex.irradiance[triangle] * weights[..., None]).sum(1)
    # Two triangles can't hold a patch of sun: what would be less than no light is cut off.
    assert shown.mean() == pytest.approx(page.mean(), rel=0.03), "mean over all surfaces"
    for node in np.unique(engine.node[triangle]):
        at = engine.node[triangle] == node
        if at.sum() > 500:
            assert shown[at].mean() == pytest.approx(page[at].mean(), rel=0.05, abs=0.01 * float(page.mean())), engine.names[node]
