"""Lights as the command reads them, against usd-core's own functions."""

import json

import pytest
from conftest import lumel
from pxr import Sdf, Usd, UsdGeom, UsdLux

GEOMETRY = ["/geo/a", "/geo/b", "/geo/group/c", "/geo/group/d"]


def new_stage(path) -> Usd.Stage:
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 1)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    for i, name in enumerate(GEOMETRY):
        mesh = UsdGeom.Mesh.Define(stage, name)
        mesh.CreatePointsAttr([(i, 0, 0), (i, 0, 1), (i + 0.5, 0, 1), (i + 0.5, 0, 0)])
        mesh.CreateFaceVertexCountsAttr([4])
        mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
        mesh.CreateSubdivisionSchemeAttr("none")
    return stage


def inspected(stage: Usd.Stage) -> dict[str, dict]:
    stage.Save()
    run = lumel("inspect", "--json", stage.GetRootLayer().realPath)
    assert run.returncode == 0, run.stderr
    return {light["name"]: light for light in json.loads(run.stdout)["lights"]}


def link(light, which: str, root: bool | None, includes=(), excludes=(), rule=None, expression=None):
    api = UsdLux.LightAPI(light)
    c = api.GetLightLinkCollectionAPI() if which == "light" else api.GetShadowLinkCollectionAPI()
    if root is not None:
        c.CreateIncludeRootAttr(root)
    for path in includes:
        c.CreateIncludesRel().AddTarget(path)
    for path in excludes:
        c.CreateExcludesRel().AddTarget(path)
    if rule:
        c.CreateExpansionRuleAttr(rule)
    if expression:
        c.CreateMembershipExpressionAttr(Sdf.PathExpression(expression))


def test_links_are_usd_core_s(tmp_path):
    """Each light is linked to as many surfaces as usd-core's membership queries hold."""
    stage = new_stage(tmp_path / "links.usda")
    cases = {
        "root": dict(root=None, excludes=["/geo/a"]),
        "group": dict(root=False, includes=["/geo/group"]),
        "nested": dict(root=False, includes=["/geo"], excludes=["/geo/group"]),
        "again": dict(root=False, includes=["/geo", "/geo/group/c"], excludes=["/geo/group"]),
        "explicit": dict(root=False, includes=["/geo/group", "/geo/a"], rule="explicitOnly"),
        "expression": dict(root=False, expression="/geo/group// /geo/b"),
        "except": dict(root=False, expression="/geo// - /geo/group//"),
        "none": dict(root=False),
    }
    for name, case in cases.items():
        for which in ("light", "shadow"):
            link(UsdLux.SphereLight.Define(stage, f"/{which}_{name}").GetPrim(), which, **case)
    # A collection that includes another one.
    other = Usd.CollectionAPI.Apply(stage.GetPrimAtPath("/geo"), "some")
    other.CreateIncludesRel().AddTarget("/geo/b")
    light = UsdLux.SphereLight.Define(stage, "/light_by_collection").GetPrim()
    link(light, "light", root=False, includes=[other.GetCollectionPath()])
    lights = inspected(stage)
    for path, found in lights.items():
        api = UsdLux.LightAPI(stage.GetPrimAtPath(path))
        for collection, key in ((api.GetLightLinkCollectionAPI(), "lights_surfaces"), (api.GetShadowLinkCollectionAPI(), "blocking_surfaces")):
            query = collection.ComputeMembershipQuery()
            expected = sum(query.IsPathIncluded(Sdf.Path(p)) for p in GEOMETRY)
            counted = len(GEOMETRY) if found[key] is None else found[key]
            assert counted == expected, f"{path}: {key} {found[key]}, usd-core has {expected}"
    assert len(lights) == 2 * len(cases) + 1


@pytest.mark.parametrize("kelvin", [1000, 2700, 4321, 6500, 10000])
def test_temperature_and_exposure(tmp_path, kelvin):
    stage = new_stage(tmp_path / "lamp.usda")
    light = UsdLux.RectLight.Define(stage, "/lamp")
    light.CreateIntensityAttr(3)
    light.CreateExposureAttr(1.5)
    light.CreateEnableColorTemperatureAttr(True)
    light.CreateColorTemperatureAttr(kelvin)
    light.CreateColorAttr((1, 0.5, 0.25))
    found = inspected(stage)["/lamp"]
    expected = [3 * 2**1.5 * t * c for t, c in zip(UsdLux.BlackbodyTemperatureAsRgb(kelvin), (1, 0.5, 0.25))]
    assert found["value"] == pytest.approx(expected, rel=1e-4, abs=1e-6)


def test_normalized_lights_keep_their_power(tmp_path):
    """A normalized area light gives pi times its intensity, whatever its size and scale."""
    stage = new_stage(tmp_path / "normalized.usda")
    for kind in ("RectLight", "DiskLight", "SphereLight", "CylinderLight"):
        for scale in (1.0, 2.5):
            light = getattr(UsdLux, kind).Define(stage, f"/{kind}_{str(scale).replace('.', '_')}")
            light.CreateNormalizeAttr(True)
            light.CreateIntensityAttr(7)
            UsdGeom.Xformable(light).AddScaleOp().Set((scale, scale, scale))
    for name, light in inspected(stage).items():
        assert light["power"] == pytest.approx(7 * 3.14159265, rel=1e-4), name
