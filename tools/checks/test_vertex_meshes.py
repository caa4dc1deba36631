"""Meshes that were cut for the light: what GLB and USD hold is one surface, the given one, and readers find nothing wrong."""

from collections import Counter

import numpy as np
import pytest
from baked import triangles
from baked.gltf import Document
from conftest import SAMPLE_BAKES, SAMPLES
from pxr import Usd, UsdGeom, UsdUtils

SCENES = ["cornell_box.glb", "cornell_box.usda", "sunroom.usda"]
CUT = ("--mesh", "adaptive")


def cut(bake, name: str, *more):
    path, *arguments = SAMPLE_BAKES[name]
    return bake(SAMPLES / path, *arguments, *CUT, *more)


def rim(corners: np.ndarray) -> float:
    """The length of the edges that no other triangle runs along the other way, by the bits of their ends [m]."""
    ends = corners + 0.0
    key = [[p.tobytes() for p in t] for t in ends]
    count: Counter = Counter()
    length = {}
    for t, places in zip(key, ends, strict=True):
        for k in range(3):
            a, b = t[k], t[(k + 1) % 3]
            count[min(a, b), max(a, b)] += 1 if a < b else -1
            length[min(a, b), max(a, b)] = np.linalg.norm(places[k] - places[(k + 1) % 3])
    return sum(length[e] * abs(n) for e, n in count.items())


@pytest.mark.parametrize("name", SCENES)
def test_validator_finds_no_error(name, bake, gltf_errors):
    for done in (cut(bake, name), cut(bake, name, "--vertex-colors", "u8"), cut(bake, name, "--vertex-colors", "u16")):
        assert gltf_errors(done.vertex_glb) == {done.vertex_glb.name: []}


@pytest.mark.parametrize("name", SCENES)
def test_pieces_are_the_given_surface(name, bake):
    given, pieces = triangles.load(bake.sample(name).vertex_glb), triangles.load(cut(bake, name).vertex_glb)
    assert len(pieces.page) > len(given.page), "nothing was cut"
    for node in np.unique(given.node):
        whole, found = (scene.areas()[scene.node == node].sum() for scene in (given, pieces))
        assert found == pytest.approx(whole, rel=1e-5), given.names[node]
        # Nothing tears: what is open was open before.
        whole, found = (rim(scene.position[scene.node == node]) for scene in (given, pieces))
        assert found == pytest.approx(whole, rel=1e-5), given.names[node]


@pytest.mark.parametrize("form, steps", [("u8", 255), ("u16", 65535)])
def test_small_colours_are_the_rounded_ones(form, steps, bake):
    exact, small = (Document(cut(bake, "cornell_box.glb", *more).vertex_glb) for more in ((), ("--vertex-colors", form)))
    assert small.lumel()["vertexScale"] == exact.lumel()["vertexScale"]
    for mesh, other in zip(exact.json["meshes"], small.json["meshes"], strict=True):
        for a, b in zip(mesh["primitives"], other["primitives"], strict=True):
            color, rounded = (d.accessor(p["attributes"]["COLOR_0"])[:, :3] for d, p in ((exact, a), (small, b)))
            assert np.abs(color - rounded).max() <= 0.5 / steps + 1e-6
            light = [d.accessor(p["attributes"]["_IRRADIANCE"]) for d, p in ((exact, a), (small, b))]
            assert np.array_equal(*light)


@pytest.mark.parametrize("name", ["cornell_box.glb", "sunroom.usda"])
def test_blender_reads_every_vertex(name, bake, blender):
    done = cut(bake, name)
    doc = Document(done.vertex_glb)
    primitives = [p["attributes"] for m in doc.json["meshes"] for p in m["primitives"]]
    light = [doc.accessor(a["_IRRADIANCE"]) for a in primitives]
    found = [m["attributes"]["_IRRADIANCE"] for m in blender("list_imported.py", done.vertex_glb)["meshes"].values()]
    assert sum(a["count"] for a in found) == sum(map(len, light))
    assert max(a["max"] for a in found) == pytest.approx(max(float(v.max()) for v in light), rel=1e-5), "clipped"


@pytest.mark.parametrize("name", ["cornell_box.usda", "sunroom.usda"])
def test_the_layer_of_pieces_is_the_stage_with_other_meshes(name, bake):
    done = cut(bake, name)
    path = done.layer.with_name(done.layer.name.replace(".lumel.", ".vertex."))
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    stage, before = Usd.Stage.Open(str(path)), Usd.Stage.Open(str(done.scene))
    assert [str(d.commentary) for d in delegate.TakeUncoalescedDiagnostics()] == []
    paths = [{str(p.GetPath()) for p in Usd.PrimRange.Stage(s, Usd.TraverseInstanceProxies())} for s in (stage, before)]
    assert paths[0] == paths[1]
    shown = triangles.load(done.vertex_glb)
    meshes = [p for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)]
    assert meshes
    for prim in meshes:
        mesh, api = UsdGeom.Mesh(prim), UsdGeom.PrimvarsAPI(prim)
        points = np.array(mesh.GetPointsAttr().Get(), float)
        counts, indices = np.array(mesh.GetFaceVertexCountsAttr().Get()), np.array(mesh.GetFaceVertexIndicesAttr().Get())
        ok, reason = UsdGeom.Mesh.ValidateTopology(indices.tolist(), counts.tolist(), len(points))
        assert ok, f"{prim.GetPath()}: {reason}"
        for primvar in api.GetPrimvarsWithValues():
            sizes = {"vertex": len(points), "varying": len(points), "faceVarying": len(indices), "uniform": len(counts), "constant": 1}
            flat = primvar.ComputeFlattened()
            assert primvar.GetInterpolation() == "constant" or len(flat) == sizes[primvar.GetInterpolation()], primvar.GetName()
        light = api.GetPrimvar("lumel:irradiance")
        assert light.HasValue(), prim.GetPath()
        of_glb = shown.irradiance[shown.node == shown.names.index(str(prim.GetPath()))]
        assert np.array(light.ComputeFlattened()).max() == pytest.approx(float(np.nanmax(of_glb)), rel=1e-6)
        bound = [UsdGeom.Subset(c).GetIndicesAttr().Get() for c in prim.GetChildren() if c.IsA(UsdGeom.Subset)]
        assert all(0 <= i < len(counts) for indices in bound for i in indices)
