"""Roles of objects: the files that come out are sound and say what was asked for, and stages that usd-core wrote are understood."""

import json

import pytest
from conftest import lumel
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdUtils

CONFIG = """
[[objects]]
path = "table"
receives = false
[[objects]]
path = "chair_1"
casts = false
[[objects]]
path = "chair_2"
lightmapped = false
[[objects]]
path = "crate"
lightmapped = false
[[objects]]
path = "floor"
density-scale = 2
"""


@pytest.fixture(scope="module")
def room(bake, tmp_path_factory):
    """The sunroom with a role for each kind of object."""
    config = tmp_path_factory.mktemp("roles") / "roles.toml"
    config.write_text(CONFIG)
    samples = bake.sample("sunroom.usda").scene
    return bake(samples, "--quality", "medium", "--resolution", "256", "--config", config)


def test_the_layer_is_silent_and_places_what_is_shown(room):
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    stage = Usd.Stage.Open(str(room.layer))
    assert [str(d.commentary) for d in delegate.TakeUncoalescedDiagnostics()] == []
    primvars = lambda path: UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(path))
    assert primvars("/sunroom/floor").HasPrimvar("lumel:scaleOffset")
    assert not stage.GetPrimAtPath("/sunroom/table").HasAttribute("lumel:lightmap")
    assert not primvars("/sunroom/table").HasPrimvar("lumel:irradiance")
    assert primvars("/sunroom/crate").HasPrimvar("lumel:irradiance")
    assert not primvars("/sunroom/crate").HasPrimvar("lumel:scaleOffset")
    assert primvars("/sunroom/chair_1").HasPrimvar("lumel:scaleOffset:seat")
    assert not primvars("/sunroom/chair_2").HasPrimvar("lumel:scaleOffset:seat")


def test_the_validator_finds_no_error(room, gltf_errors):
    for file, errors in gltf_errors(room.glb, room.vertex_glb).items():
        assert errors == [], file


def test_the_balance_closes(room):
    assert abs(room.report["energy"]["imbalance"]) < 0.005


def test_opinions_of_usd_core_are_inherited_as_it_composes_them(tmp_path):
    """Values of either precision, through references, instances and a stronger layer."""
    asset = Usd.Stage.CreateNew(str(tmp_path / "asset.usdc"))
    root = UsdGeom.Xform.Define(asset, "/Asset").GetPrim()
    asset.SetDefaultPrim(root)
    root.CreateAttribute("lumel:casts", Sdf.ValueTypeNames.Bool).Set(False)
    mesh = UsdGeom.Mesh.Define(asset, "/Asset/Square")
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    mesh.CreateDisplayColorAttr([(0.5, 0.5, 0.5)])
    asset.Save()

    stage = Usd.Stage.CreateNew(str(tmp_path / "scene.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdLux.SphereLight.Define(stage, "/Lamp").AddTranslateOp().Set(Gf.Vec3d(0, 0, 3))
    for name, instanceable in [("Plain", False), ("First", True), ("Second", True)]:
        prim = UsdGeom.Xform.Define(stage, f"/Group/{name}").GetPrim()
        prim.GetReferences().AddReference("./asset.usdc")
        prim.SetInstanceable(instanceable)
    group = stage.GetPrimAtPath("/Group")
    group.CreateAttribute("lumel:densityScale", Sdf.ValueTypeNames.Double).Set(0.5)
    stage.GetPrimAtPath("/Group/Second").CreateAttribute("lumel:casts", Sdf.ValueTypeNames.Bool).Set(True)
    over = stage.OverridePrim("/Group/Plain/Square")
    over.CreateAttribute("lumel:receives", Sdf.ValueTypeNames.Bool).Set(False)
    over.CreateAttribute("lumel:casts", Sdf.ValueTypeNames.Bool).Set(True)
    stage.Save()

    seen = json.loads(lumel("inspect", tmp_path / "scene.usda", "--json", "--density", "10").stdout)
    roles = {s["name"]: (s["role"], s["density"]) for s in seen["surfaces"]}
    assert roles == {
        "/Group/Plain/Square": ("casts only", pytest.approx(1.25)),
        "/Group/First/Square": ("receives only", pytest.approx(5.0)),
        "/Group/Second/Square": ("lit", pytest.approx(5.0)),
    }
