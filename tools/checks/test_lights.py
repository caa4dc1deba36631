"""Lights as the command reads them, against usd-core's own functions; and as they shine, against Cycles."""

import json

import numpy as np
import pytest
from baked.gltf import Document
from baked.pages import read_page
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
    # One that holds a group on its own alone, within one that holds everything.
    alone = Usd.CollectionAPI.Apply(stage.GetPrimAtPath("/geo"), "alone")
    alone.CreateExpansionRuleAttr("explicitOnly")
    alone.CreateIncludesRel().AddTarget("/geo/group")
    light = UsdLux.SphereLight.Define(stage, "/light_alone").GetPrim()
    link(light, "light", root=True, includes=[alone.GetCollectionPath()], excludes=["/geo/a"])
    lights = inspected(stage)
    for path, found in lights.items():
        api = UsdLux.LightAPI(stage.GetPrimAtPath(path))
        for collection, key in ((api.GetLightLinkCollectionAPI(), "lights_surfaces"), (api.GetShadowLinkCollectionAPI(), "blocking_surfaces")):
            query = collection.ComputeMembershipQuery()
            expected = sum(query.IsPathIncluded(Sdf.Path(p)) for p in GEOMETRY)
            counted = len(GEOMETRY) if found[key] is None else found[key]
            assert counted == expected, f"{path}: {key} {found[key]}, usd-core has {expected}"
    assert len(lights) == 2 * len(cases) + 2


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


def floor_of(stage: Usd.Stage, cells: int = 16) -> None:
    """A floor of 2 x 2 m as a grid, so that vertices sample the light."""
    at = [2 * i / cells - 1 for i in range(cells + 1)]
    mesh = UsdGeom.Mesh.Define(stage, "/floor")
    mesh.CreatePointsAttr([(x, 0, z) for z in at for x in at])
    n = cells + 1
    faces = [(i + k * n, i + (k + 1) * n, i + 1 + (k + 1) * n, i + 1 + k * n) for k in range(cells) for i in range(cells)]
    mesh.CreateFaceVertexCountsAttr([4] * len(faces))
    mesh.CreateFaceVertexIndicesAttr([v for face in faces for v in face])
    mesh.CreateSubdivisionSchemeAttr("none")
    mesh.CreateDisplayColorAttr([(0.5, 0.5, 0.5)])


LIGHTS = {
    # Kind, attributes, radiance and radius of a ball.
    "rect": ("RectLight", {"width": 0.6, "height": 0.4, "intensity": 20}, 20, 0),
    "disk": ("DiskLight", {"radius": 0.3, "intensity": 20}, 20, 0),
    "ball": ("SphereLight", {"radius": 0.2, "intensity": 20}, 20, 0.2),
    "sun": ("DistantLight", {"angle": 4.0, "intensity": 300}, 0, 0),
}


def test_blender_sees_the_same_light(tmp_path, bake, blender):
    """A floor under each kind of light: Cycles and the bake agree within 2 % at every vertex away from the rim."""
    for name, (kind, attributes, _, _) in LIGHTS.items():
        stage = Usd.Stage.CreateNew(str(tmp_path / f"{name}.usda"))
        UsdGeom.SetStageMetersPerUnit(stage, 1)
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
        floor_of(stage)
        light = getattr(UsdLux, kind).Define(stage, "/lamp")
        for key, value in attributes.items():
            light.GetPrim().GetAttribute(f"inputs:{key}").Set(value)
        xform = UsdGeom.Xformable(light)
        xform.AddTranslateOp().Set((0.2, 1.2, -0.1))
        xform.AddRotateXYZOp().Set((-75, 20, 0))
        stage.Save()
    blender("render_lights.py", tmp_path, 256, *(f"{n}:{radiance}:{radius}" for n, (_, _, radiance, radius) in LIGHTS.items()))
    for name in LIGHTS:
        done = bake(tmp_path / f"{name}.usda", "--quality", "high", "--resolution", "128", "--max-bounces", "0")
        pixels = read_page(tmp_path / f"{name}.exr").rgb
        size = pixels.shape[0]
        found, expected = [], []
        document = Document(done.vertex_glb)
        for primitive in (p for m in document.json["meshes"] for p in m["primitives"]):
            positions = document.accessor(primitive["attributes"]["POSITION"])
            light = document.accessor(primitive["attributes"]["_IRRADIANCE"])
            for (x, _, z), e in zip(positions, light):
                if max(abs(x), abs(z)) < 0.8:
                    # The mean of the four pixels around the vertex; grid lines are pixel edges.
                    i, k = round((x + 1) / 2 * size), round((z + 1) / 2 * size)
                    found.append(np.mean(e[:3]))
                    expected.append(pixels[k - 1 : k + 1, i - 1 : i + 1].mean())
        found, expected = np.array(found), np.array(expected)
        scale = found.mean() / expected.mean()
        print(f"{name}: mean {scale:.4f}, worst {np.abs(found / expected / scale - 1).max():.4f}")
        assert len(found) > 100
        # Both hold E / pi.
        assert scale == pytest.approx(1, abs=0.02), name
        assert np.abs(found / expected - 1).max() < 0.02, name
