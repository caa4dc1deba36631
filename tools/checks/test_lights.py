"""Lights as the command reads them, against usd-core's own functions; and as they shine, against Cycles."""

import json

import numpy as np
import OpenEXR
import pytest
from baked import triangles
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


def stage_with_floor(path) -> Usd.Stage:
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 1)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    floor_of(stage)
    return stage


def on_floor(bake, folder, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices of the floor away from its rim, x and z, and what the bake and Cycles find there, E / pi by channel: the mean of the
    four pixels around a vertex, as grid lines are pixel edges."""
    done = bake(folder / f"{name}.usda", "--quality", "high", "--resolution", "128", "--max-bounces", "0")
    pixels = read_page(folder / f"{name}.exr").rgb
    size = pixels.shape[0]
    places, found, expected = [], [], []
    engine = triangles.load(done.glb)
    corners = engine.position.reshape(-1, 3)
    light = np.concatenate([triangles.lightmap_at(engine, np.arange(len(engine.position)), np.eye(3)[np.full(len(engine.position), k)]) for k in range(3)])
    light = light.reshape(3, -1, 3).transpose(1, 0, 2).reshape(-1, 3)
    known = set()
    for (x, y, z), e in zip(corners, light):
        if y == 0 and max(abs(x), abs(z)) < 0.8 and (x, z) not in known:
            known.add((x, z))
            i, k = round((x + 1) / 2 * size), round((z + 1) / 2 * size)
            places.append((x, z))
            found.append(e)
            expected.append(pixels[k - 1 : k + 1, i - 1 : i + 1].mean((0, 1)))
    assert len(found) > 100
    return np.array(places), np.array(found), np.array(expected)


def quarters(places: np.ndarray) -> list[np.ndarray]:
    """Which vertices lie in each quarter of the floor, away from the lines between them."""
    return [(places * signs > 0.06).all(1) for signs in ((-1, -1), (1, -1), (-1, 1), (1, 1))]


def test_blender_sees_the_same_light(tmp_path, bake, blender):
    """A floor under each kind of light: Cycles and the bake agree within 2 % at every vertex away from the rim."""
    for name, (kind, attributes, _, _) in LIGHTS.items():
        stage = stage_with_floor(tmp_path / f"{name}.usda")
        light = getattr(UsdLux, kind).Define(stage, "/lamp")
        for key, value in attributes.items():
            light.GetPrim().GetAttribute(f"inputs:{key}").Set(value)
        xform = UsdGeom.Xformable(light)
        xform.AddTranslateOp().Set((0.2, 1.2, -0.1))
        xform.AddRotateXYZOp().Set((-75, 20, 0))
        stage.Save()
    blender("render_lights.py", tmp_path, 256, *(f"{n}:{radiance}:{radius}" for n, (_, _, radiance, radius) in LIGHTS.items()))
    for name in LIGHTS:
        _, found, expected = on_floor(bake, tmp_path, name)
        found, expected = found.mean(1), expected.mean(1)
        scale = found.mean() / expected.mean()
        print(f"{name}: mean {scale:.4f}, worst {np.abs(found / expected / scale - 1).max():.4f}")
        # Both hold E / pi.
        assert scale == pytest.approx(1, abs=0.02), name
        assert np.abs(found / expected - 1).max() < 0.02, name


def blobs(path, height: int, width: int, centres) -> None:
    """A picture of a soft blob in each channel, around (u, v) by channel, u going round; v down."""
    v, u = np.mgrid[0:height, 0:width]
    u, v = (u + 0.5) / width, (v + 0.5) / height
    away = lambda cu: (u - cu + 0.5) % 1 - 0.5
    channels = [0.05 + 3 * np.exp(-((away(cu) / 0.12) ** 2) - ((v - cv) / 0.2) ** 2) for cu, cv in centres]
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": np.stack(channels, -1).astype(np.float32)}) as file:
        file.write(str(path))


# Candela of a lamp without any symmetry, each 10 degrees from below and 30 degrees around; smooth, as Blender reads it by cubics.
WEB = [[100 + 60 * np.cos(np.radians(h - 50)) * np.sin(np.radians(v)) - v / 2 for v in range(0, 91, 10)] for h in range(0, 361, 30)]


def web_file() -> str:
    rows = "\n".join(" ".join(f"{c:.3f}" for c in column) for column in WEB)
    verticals, horizontals = " ".join(map(str, range(0, 91, 10))), " ".join(map(str, range(0, 361, 30)))
    return f"IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 {len(WEB[0])} {len(WEB)} 1 2 0 0 0\n1 1 0\n{verticals}\n{horizontals}\n{rows}\n"


# What the stage says, and the same for Blender. A ball of radius r as a point has pi r^2 times its radiance as intensity.
POINT = {"radius": 0.1, "intensity": 300}
SHAPED = {
    "cone": (dict(kind="point", cone=40, softness=0.6), {"shaping:cone:angle": 40, "shaping:cone:softness": 0.6}),
    "focus": (dict(kind="point", focus=6), {"shaping:focus": 6}),
    "disk": (dict(kind="disk", size=0.2, radiance=60, cone=60, softness=0.4, focus=2), {"shaping:cone:angle": 60, "shaping:cone:softness": 0.4, "shaping:focus": 2}),
    "ies": (dict(kind="point", ies="lamp.ies"), {"shaping:ies:file": Sdf.AssetPath("lamp.ies")}),
    "projector": (dict(kind="point", fov=80, picture="blobs.exr"), {}),
    "picture": (dict(kind="plane", size=0.5, radiance=30, picture="blobs.exr"), {"texture:file": Sdf.AssetPath("blobs.exr")}),
}


def shaped_light(stage: Usd.Stage, light: dict, inputs: dict) -> None:
    """Adds a light to the stage, and its matrix and intensity to what Blender is told."""
    kind = {"point": UsdLux.SphereLight, "disk": UsdLux.DiskLight, "plane": UsdLux.RectLight}[light["kind"]]
    lamp = kind.Define(stage, "/lamp")
    UsdLux.ShapingAPI.Apply(lamp.GetPrim()).CreateShapingConeAngleAttr(180)
    if light["kind"] == "point":
        inputs = POINT | inputs
        lamp.CreateTreatAsPointAttr(True)
        light["intensity"] = np.pi * POINT["radius"] ** 2 * POINT["intensity"]
    else:
        size = {"radius": light["size"] / 2} if light["kind"] == "disk" else {"width": light["size"], "height": light["size"]}
        inputs = size | {"intensity": light["radiance"]} | inputs
    for key, value in inputs.items():
        assert lamp.GetPrim().GetAttribute(f"inputs:{key}").Set(value), key
    if "fov" in light:
        lamp.GetPrim().CreateAttribute("lumel:projector", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(light["picture"]))
        lamp.GetPrim().CreateAttribute("lumel:projector:fov", Sdf.ValueTypeNames.Float).Set(light["fov"])
    xform = UsdGeom.Xformable(lamp)
    xform.AddTranslateOp().Set((0.2, 1.2, -0.1))
    xform.AddRotateXYZOp().Set((-75, 20, 0))
    light["matrix"] = np.array(xform.ComputeLocalToWorldTransform(Usd.TimeCode.Default())).T.tolist()


def test_blender_sees_the_same_shapes_profiles_and_pictures(tmp_path, bake, blender):
    """Cycles and the bake agree within 1 % in the mean of each channel over the floor, and within 3 % over each quarter. Where Cycles has
    no noise to speak of, they agree everywhere within 3 % of the brightest: a vertex stands for pixels on either side of a
    picture's rim, and Blender reads profiles by cubics."""
    blobs(tmp_path / "blobs.exr", 32, 48, [(0.3, 0.3), (0.6, 0.4), (0.5, 0.75)])
    (tmp_path / "lamp.ies").write_text(web_file())
    lights = {}
    for name, (light, inputs) in SHAPED.items():
        stage = stage_with_floor(tmp_path / f"{name}.usda")
        lights[name] = dict(light)
        shaped_light(stage, lights[name], inputs)
        stage.Save()
    (tmp_path / "lights.json").write_text(json.dumps(lights))
    blender("render_built_lights.py", tmp_path, 128)
    for name, (light, _) in SHAPED.items():
        places, found, expected = on_floor(bake, tmp_path, name)
        means, worst = found.mean(0) / expected.mean(0), np.abs(found - expected).max() / expected.max()
        parts = np.array([found[part].mean(0) / expected[part].mean(0) for part in quarters(places)])
        print(f"{name}: means {means.round(4)}, of quarters up to {np.abs(parts - 1).max():.4f}, worst {worst:.4f} of the brightest")
        assert means == pytest.approx(1, abs=0.01), name
        assert parts == pytest.approx(1, abs=0.03), name
        assert worst < 0.03 or light["kind"] == "plane", name


def test_blender_turns_a_dome_the_same_way(tmp_path, bake, blender):
    """Two walls part the floor in four, of which each sees a quarter of a sky with a picture, turned about its pole: Cycles and the
    bake agree within 2 % in the mean of each quarter and channel."""
    blobs(tmp_path / "blobs.exr", 64, 128, [(0.15, 0.3), (0.45, 0.2), (0.8, 0.35)])
    stage = stage_with_floor(tmp_path / "sky.usda")
    for name, (x, z) in {"along": (1, 0), "across": (0, 1)}.items():
        wall = UsdGeom.Mesh.Define(stage, f"/{name}")
        wall.CreatePointsAttr([(-x, 0, -z), (x, 0, z), (x, 1, z), (-x, 1, -z)])
        wall.CreateFaceVertexCountsAttr([4])
        wall.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
        wall.CreateSubdivisionSchemeAttr("none")
        wall.CreateDoubleSidedAttr(True)
    dome = UsdLux.DomeLight.Define(stage, "/sky")
    dome.CreateIntensityAttr(2)
    dome.CreateTextureFileAttr("blobs.exr")
    UsdGeom.Xformable(dome).AddRotateYOp().Set(40)
    stage.Save()
    (tmp_path / "lights.json").write_text(json.dumps({"sky": {"kind": "sky", "matrix": np.eye(4).tolist()}}))
    blender("render_built_lights.py", tmp_path, 512)
    places, found, expected = on_floor(bake, tmp_path, "sky")
    means = np.array([found[part].mean(0) / expected[part].mean(0) for part in quarters(places)])
    light = np.array([expected[part].mean(0) for part in quarters(places)])
    print(f"quarters {light.round(3).tolist()}, the bake over Blender's {means.round(4).tolist()}")
    assert (light.max(0) > 1.5 * light.min(0)).all(), "a sky turned otherwise would look the same"
    assert means == pytest.approx(1, abs=0.02)
