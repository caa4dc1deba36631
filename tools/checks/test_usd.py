"""The override layers open in usd-core and hold what the pages hold."""

import os
from pathlib import Path

import numpy as np
import pytest
from baked import triangles
from pxr import Sdf, Usd, UsdGeom, UsdUtils, UsdValidation

LAYERS = ["cornell_box.usda", "furnace.usda", "sunroom.usda"]


@pytest.fixture(params=LAYERS)
def opened(request, bake):
    """A bake with its stage; opening it must be silent."""
    done = bake.sample(request.param)
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    stage = Usd.Stage.Open(str(done.layer))
    said = [str(d.commentary) for d in delegate.TakeUncoalescedDiagnostics()]
    assert said == []
    return done, stage


def baked_meshes(stage) -> list[Usd.Prim]:
    prims = Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies())
    return [p for p in prims if p.IsA(UsdGeom.Mesh)]


def attribute_above(prim: Usd.Prim, name: str):
    """The attribute of the prim, or of the nearest ancestor that has it: instances keep theirs on their root."""
    while prim and not prim.IsPseudoRoot():
        attribute = prim.GetAttribute(name)
        if attribute and attribute.HasAuthoredValue():
            return attribute
        prim = prim.GetParent()
    return None


def lightmap_uvs(prim: Usd.Prim) -> np.ndarray:
    """The faceVarying UVs on the page, v up, one row a corner."""
    st1 = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("st1")
    assert st1 and st1.HasValue(), f"{prim.GetPath()}: no primvars:st1"
    assert st1.GetInterpolation() == UsdGeom.Tokens.faceVarying
    assert st1.GetTypeName() == Sdf.ValueTypeNames.TexCoord2fArray
    uv = np.array(st1.ComputeFlattened(), float)
    corners = sum(UsdGeom.Mesh(prim).GetFaceVertexCountsAttr().Get())
    assert len(uv) == corners, f"{prim.GetPath()}: {len(uv)} UVs for {corners} corners"
    place = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("lumel:scaleOffset" + suffix(prim))
    assert place and place.HasValue(), f"{prim.GetPath()}: no rectangle"
    sx, sy, ox, oy = place.Get()
    return uv * [sx, sy] + [ox, oy]


def suffix(prim: Usd.Prim) -> str:
    """What distinguishes a mesh's rectangle and page among those on its instance's root: its path below, `:` for `/`."""
    root = prim
    for path in prim.GetPath().GetPrefixes():
        if prim.GetStage().GetPrimAtPath(path).IsInstance():
            root = prim.GetStage().GetPrimAtPath(path)
            break
    below = str(prim.GetPath())[len(str(root.GetPath())) :].replace("/", ":")
    return below if root.HasAttribute("lumel:lightmap" + below) else ""


def page_of(prim: Usd.Prim) -> Path:
    attribute = attribute_above(prim, "lumel:lightmap" + suffix(prim))
    assert attribute, f"{prim.GetPath()}: no lumel:lightmap"
    path = attribute.Get().resolvedPath
    assert path and os.path.isfile(path), f"{prim.GetPath()}: {attribute.Get()} does not resolve"
    return Path(path)


def at_corners(prim: Usd.Prim, primvar) -> np.ndarray:
    """A vertex or faceVarying primvar, one row a corner."""
    values = np.array(primvar.ComputeFlattened(), float)
    if primvar.GetInterpolation() == UsdGeom.Tokens.vertex:
        values = values[np.array(UsdGeom.Mesh(prim).GetFaceVertexIndicesAttr().Get())]
    return values


def test_the_input_stays_as_it_was(opened):
    done, stage = opened
    root = stage.GetRootLayer()
    assert [Path(root.ComputeAbsolutePath(p)).resolve() for p in root.subLayerPaths] == [done.scene.resolve()]
    source = Usd.Stage.Open(str(done.scene))
    assert UsdGeom.GetStageUpAxis(stage) == UsdGeom.GetStageUpAxis(source)
    assert UsdGeom.GetStageMetersPerUnit(stage) == UsdGeom.GetStageMetersPerUnit(source)
    assert stage.GetDefaultPrim().GetPath() == source.GetDefaultPrim().GetPath()
    for prim in Usd.PrimRange.Stage(source, Usd.TraverseInstanceProxies()):
        same = stage.GetPrimAtPath(prim.GetPath())
        assert same and same.GetTypeName() == prim.GetTypeName(), prim.GetPath()
        assert same.IsInstance() == prim.IsInstance(), f"{prim.GetPath()} is no instance any more"
        if prim.IsA(UsdGeom.Mesh):
            assert same.GetAttribute("points").Get() == prim.GetAttribute("points").Get()


def test_uvs_and_page_of_every_mesh_resolve(opened):
    _, stage = opened
    meshes = baked_meshes(stage)
    assert meshes
    for prim in meshes:
        uv = lightmap_uvs(prim)
        assert uv.min() >= 0 and uv.max() <= 1, prim.GetPath()
        assert np.ptp(uv, axis=0).min() > 0, prim.GetPath()
        assert page_of(prim).suffix == ".exr"
        assert attribute_above(prim, "lumel:quantity").Get() == "outgoing"


def test_light_is_that_of_the_vertex_glb(opened):
    """`primvars:lumel:irradiance` holds the same values, prim by prim, as the GLB with vertex colours, which is held against the page."""
    done, stage = opened
    other = triangles.load(done.vertex_glb)
    compared = 0
    for prim in baked_meshes(stage):
        primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar("lumel:irradiance")
        if not (primvar and primvar.HasValue()):
            assert prim.IsInstanceProxy(), f"{prim.GetPath()}: no primvars:lumel:irradiance"
            continue
        given = np.unique(at_corners(prim, primvar), axis=0)
        light = np.unique(other.irradiance[other.node == other.names.index(str(prim.GetPath()))].reshape(-1, 3), axis=0)
        assert given.shape == light.shape and np.allclose(given, light, rtol=1e-5), prim.GetPath()
        compared += 1
    assert compared >= 3


def test_display_colour_shows_the_light(opened):
    _, stage = opened
    shown = 0
    for prim in baked_meshes(stage):
        if prim.IsInstanceProxy():
            continue
        color = UsdGeom.PrimvarsAPI(prim).GetPrimvar("displayColor")
        assert color and color.HasValue(), f"{prim.GetPath()}: no displayColor"
        irradiance = UsdGeom.PrimvarsAPI(prim).GetPrimvar("lumel:irradiance")
        np.testing.assert_allclose(at_corners(prim, color), at_corners(prim, irradiance), rtol=1e-5)
        shown += 1
    assert shown


def test_validators_find_no_more_than_in_the_input(opened):
    done, stage = opened

    def found(s) -> list[str]:
        context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
        return sorted(f"{e.GetName()}: {e.GetMessage()}" for e in context.Validate(s))

    more = [e for e in found(stage) if e not in found(Usd.Stage.Open(str(done.scene)))]
    assert more == []


def test_instances_have_places_of_their_own(bake):
    """The chairs share their UVs and stay instances; each has its own rectangle."""
    stage = Usd.Stage.Open(str(bake.sample("sunroom.usda").layer))
    chairs = [stage.GetPrimAtPath(f"/sunroom/chair_{k}") for k in (1, 2, 3)]
    assert all(c.IsInstance() for c in chairs)
    assert len({c.GetPrototype().GetPath() for c in chairs}) == 1
    boxes = {}
    for chair in chairs:
        for prim in Usd.PrimRange(chair, Usd.TraverseInstanceProxies()):
            if prim.IsA(UsdGeom.Mesh):
                uv = lightmap_uvs(prim)
                boxes[str(prim.GetPath())] = (uv.min(0), uv.max(0))
    assert len(boxes) == 6
    for one in boxes:
        for other in boxes:
            (a, b), (c, d) = boxes[one], boxes[other]
            assert one == other or (b <= c).any() or (d <= a).any(), f"{one} and {other} lie on each other's texels"
