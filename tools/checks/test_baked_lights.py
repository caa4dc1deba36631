"""Lights that are baked wholly, in part or not at all, through whole bakes: what usd-core and the glTF validator make of the files."""

import json

import pytest
from baked.gltf import Document
from conftest import lumel
from pxr import Sdf, Usd, UsdGeom, UsdLux

MODES = ("baked", "indirect", "dynamic")
TOML = '[[lamps]]\nname = "by_pattern"\nbake = "indirect"\ngroup = "pattern"\n'


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    path = tmp_path_factory.mktemp("lights") / "room.usda"
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 1)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    floor = UsdGeom.Mesh.Define(stage, "/floor")
    floor.CreatePointsAttr([(-1, 0, -1), (-1, 0, 1), (1, 0, 1), (1, 0, -1)])
    floor.CreateFaceVertexCountsAttr([4])
    floor.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    floor.CreateSubdivisionSchemeAttr("none")
    for k, name in enumerate((*MODES, "by_pattern")):
        light = UsdLux.SphereLight.Define(stage, f"/lights/{name}")
        light.CreateTreatAsPointAttr(True)
        light.CreateIntensityAttr(10)
        UsdGeom.Xformable(light).AddTranslateOp().Set((0.5 * k - 0.75, 1, 0))
        if name in MODES[1:]:
            light.GetPrim().CreateAttribute("lumel:bake", Sdf.ValueTypeNames.Token).Set(name)
    stage.Save()
    (path.parent / "lumel.toml").write_text(TOML)
    return path


@pytest.mark.parametrize("lights", ["mark", "remove"])
def test_usd_layer_says_what_an_engine_has_to_do(bake, gltf_errors, stage, lights):
    baked = bake(stage, "--resolution", "64", "--lights", lights)
    opened = Usd.Stage.Open(str(baked.layer))
    for name in (*MODES, "by_pattern"):
        prim = opened.GetPrimAtPath(f"/lights/{name}")
        has = lambda attribute: prim.GetAttribute(attribute).Get()
        if name == "baked":
            assert prim.IsActive() == (lights == "mark")
            assert lights == "remove" or has("lumel:baked") is True
            continue
        assert prim.IsActive() and has("lumel:baked") is None
        assert has("lumel:realtime") == (None if name == "dynamic" else "direct")
        assert has("lumel:bake") == ("dynamic" if name == "dynamic" else "indirect")
    modes = {light["name"]: light["bake"] for light in baked.report["lights"]}
    assert modes == {f"/lights/{n}": "indirect" if n == "by_pattern" else n for n in (*MODES, "by_pattern")}
    # The GLB of a USD scene holds the same lights, told alike.
    glb = Document(baked.glb)
    nodes = {node["name"]: node for node in glb.json["nodes"] if "KHR_lights_punctual" in node.get("extensions", {})}
    assert set(nodes) == {f"/lights/{n}" for n in ((*MODES, "by_pattern") if lights == "mark" else (*MODES[1:], "by_pattern"))}
    assert nodes["/lights/indirect"]["extras"]["lumel"] == {"bake": "indirect", "realtime": "direct"}
    assert "extras" not in nodes["/lights/dynamic"]
    assert not any(gltf_errors(baked.glb, baked.vertex_glb).values())


def test_layer_can_be_baked_again(bake, stage):
    """What a layer says is understood by a second bake of it."""
    first = bake(stage, "--resolution", "64", "--lights", "mark")
    run = lumel("inspect", "--json", first.layer)
    assert run.returncode == 0, run.stderr
    found = {light["name"]: light["bake"] for light in json.loads(run.stdout)["lights"]}
    assert found == {f"/lights/{n}": "indirect" if n == "by_pattern" else n for n in (*MODES, "by_pattern")}


def test_light_groups_and_masks_are_named_in_header_and_report(bake, stage):
    baked = bake(stage, "--resolution", "64", "--layers", "light-groups,shadow-masks,ao,bent-normal,sky-visibility,emission,bounces", "--bake-lights", "baked")
    layers = {layer["name"]: layer for layer in baked.report["layers"]}
    assert layers["group.pattern"] | {"channels": 0} == {"name": "group.pattern", "channels": 0, "unit": "nit", "of": "pattern"}
    # Masks are made of what is not wholly baked.
    masks = {layer["of"]: layer["channels"] for name, layer in layers.items() if name.startswith("shadow.")}
    assert masks == {f"/lights/{n}": [f"shadow.lights_{n}.Y"] for n in ("indirect", "dynamic", "by_pattern")}
    assert layers["bent-normal"]["channels"] == [f"bent-normal.{c}" for c in "XYZ"]
    header = (baked.folder / "lightmaps" / "room_0.exr").read_bytes()[:20000]
    start = header.index(b"[{", header.index(b"lumel:layers"))
    listed = json.loads(header[start : header.index(b"}]", start) + 2])
    assert {entry["name"] for entry in listed} == set(layers)
