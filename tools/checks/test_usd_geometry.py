"""Poses, times and subdivision surfaces of USD stages are those of usd-core and of Blender's OpenSubdiv."""

import json
from pathlib import Path

import numpy as np
import pytest
from baked.gltf import Document
from baked.pages import read_page
from conftest import lumel
from pxr import Gf, Usd, UsdGeom, UsdShade, UsdSkel, UsdUtils


def unwrapped(scene: Path, folder: Path, *arguments) -> dict[str, np.ndarray]:
    """World-space points of each surface as Lumel reads the scene, each once, by the last part of its name."""
    run = lumel("unwrap", scene, "-o", folder, "--resolution", "256", "--overwrite", *arguments)
    assert run.returncode == 0, run.stderr
    doc = Document(folder / f"{scene.stem}.glb")
    found = {}
    for node, world in doc.placed_nodes():
        if "mesh" not in node:
            continue
        primitives = doc.json["meshes"][node["mesh"]]["primitives"]
        points = np.concatenate([doc.accessor(p["attributes"]["POSITION"]) for p in primitives])
        found[node["name"].rsplit("/", 1)[-1]] = unique(points @ world[:3, :3].T + world[:3, 3])
    return found


def unique(points: np.ndarray) -> np.ndarray:
    points = np.asarray(points, float)
    return points[np.unique(np.round(points, 5), axis=0, return_index=True)[1]]


def assert_same(ours: np.ndarray, theirs: np.ndarray, tolerance: float):
    """Each point of one has a point of the other within `tolerance`."""
    distance = np.linalg.norm(ours[:, None] - unique(theirs)[None], axis=2)
    worst = max(distance.min(0).max(), distance.min(1).max())
    assert worst < tolerance, f"points are {worst} apart"


def rotation(axis, degrees) -> Gf.Quatf:
    return Gf.Quatf(Gf.Rotation(Gf.Vec3d(*axis), degrees).GetQuat())


def translation(*v) -> Gf.Matrix4d:
    return Gf.Matrix4d().SetTranslate(Gf.Vec3d(*v))


def tube() -> tuple[list, list, list]:
    """A square tube of eight rings, open at both ends."""
    points = [(x, 2.5 * i / 8, z) for i in range(9) for x, z in [(-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2)]]
    faces = [[4 * i + k, 4 * i + 4 + k, 4 * i + 4 + (k + 1) % 4, 4 * i + (k + 1) % 4] for i in range(8) for k in range(4)]
    return points, [4] * len(faces), [p for f in faces for p in f]


def mesh(stage: Usd.Stage, path: str, points, counts, indices) -> UsdGeom.Mesh:
    made = UsdGeom.Mesh.Define(stage, path)
    made.GetPointsAttr().Set(points)
    made.GetFaceVertexCountsAttr().Set(counts)
    made.GetFaceVertexIndicesAttr().Set(indices)
    made.GetSubdivisionSchemeAttr().Set("none")
    return made


def animation(stage: Usd.Stage, path: str) -> UsdSkel.Animation:
    """Two samples, joints in another order than the skeleton's, stretched and bent; two blend shapes."""
    made = UsdSkel.Animation.Define(stage, path)
    made.GetJointsAttr().Set(["hip/knee", "hip", "hip/knee/foot"])
    made.GetBlendShapesAttr().Set(["fat", "tall"])
    for time, angle in [(0, 0), (10, 80)]:
        made.GetTranslationsAttr().Set([(0, 1, 0), (0, 0, 0), (0, 1, 0.1 * time)], time)
        turns = [rotation((0, 0, 1), angle), rotation((1, 0, 0), angle / 2), rotation((1, 0, 0), 0)]
        made.GetRotationsAttr().Set(turns, time)
        made.GetScalesAttr().Set([Gf.Vec3h(1), Gf.Vec3h(1, 1 + time / 20, 1), Gf.Vec3h(1)], time)
        made.GetBlendShapeWeightsAttr().Set([time / 10, time / 20], time)
    return made


def bound(prim: Usd.Prim, joints, weights, rigid: bool, width: int) -> UsdSkel.BindingAPI:
    binding = UsdSkel.BindingAPI.Apply(prim)
    binding.CreateSkeletonRel().SetTargets(["/Root/Rig/Skel"])
    binding.CreateJointIndicesPrimvar(rigid, width).Set(joints)
    binding.CreateJointWeightsPrimvar(rigid, width).Set(weights)
    return binding


def shapes(stage: Usd.Stage, binding: UsdSkel.BindingAPI, points):
    fat = UsdSkel.BlendShape.Define(stage, "/Root/Body/fat")
    fat.GetOffsetsAttr().Set([(x / 2, 0, z / 2) for x, _, z in points])
    half = fat.CreateInbetween("half")
    half.SetWeight(0.6)
    half.SetOffsets([(0, 0.1, 0)] * len(points))
    tall = UsdSkel.BlendShape.Define(stage, "/Root/Body/tall")
    tall.GetOffsetsAttr().Set([(0, 1, 0), (0, 1, 0)])
    tall.GetPointIndicesAttr().Set([34, 35])
    binding.CreateBlendShapesAttr().Set(["fat", "tall"])
    binding.CreateBlendShapeTargetsRel().SetTargets([fat.GetPath(), tall.GetPath()])


def skeleton(path: Path):
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 1)
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.Xformable(UsdSkel.Root.Define(stage, "/Root")).AddTranslateOp().Set((1, 2, 3))
    UsdGeom.Xform.Define(stage, "/Root/Rig").AddRotateYOp().Set(30)
    skel = UsdSkel.Skeleton.Define(stage, "/Root/Rig/Skel")
    skel.GetJointsAttr().Set(["hip", "hip/knee", "hip/knee/foot"])
    skel.GetBindTransformsAttr().Set([translation(0, y, 0) for y in range(3)])
    skel.GetRestTransformsAttr().Set([translation(0, y, 0) for y in [0, 1, 1]])
    made = animation(stage, "/Root/Rig/Anim")
    UsdSkel.BindingAPI.Apply(skel.GetPrim()).CreateAnimationSourceRel().SetTargets([made.GetPath()])
    points, counts, indices = tube()
    body = mesh(stage, "/Root/Body", points, counts, indices)
    body.AddTranslateOp().Set((0.3, 0, 0))
    body.AddScaleOp().Set((1, 1, 2))
    at = [min(y, 1.9999) for _, y, _ in points]
    joints = [j for y in at for j in (int(y), int(y) + 1)]
    weights = [w for y in at for w in (1 - y % 1, y % 1)]
    binding = bound(body.GetPrim(), joints, weights, False, 2)
    binding.CreateGeomBindTransformAttr().Set(translation(0.05, 0, 0))
    shapes(stage, binding, points)
    flag = mesh(stage, "/Root/Flag", [(0, 0, 0), (1, 0, 0), (0, 1, 0)], [3], [0, 1, 2])
    bound(flag.GetPrim(), [0], [1], True, 1).CreateJointsAttr().Set(["hip/knee/foot", "hip"])
    stage.GetRootLayer().Save()


@pytest.mark.parametrize("time", [0, 4, 10])
def test_poses_are_those_of_usd_core(time, tmp_path):
    scene = tmp_path / "skeleton.usda"
    skeleton(scene)
    ours = unwrapped(scene, tmp_path / "out", "--time", time)
    stage = Usd.Stage.Open(str(scene))
    for attribute in stage.GetPrimAtPath("/Root/Rig/Anim").GetAttributes():
        # Baking looks at samples alone.
        if attribute.ValueMightBeTimeVarying():
            attribute.Set(attribute.Get(time), time)
    assert UsdSkel.BakeSkinning(stage.Traverse(), Gf.Interval(time, time))
    for name in ["Body", "Flag"]:
        theirs = UsdGeom.Mesh(stage.GetPrimAtPath(f"/Root/{name}"))
        world = np.array(theirs.ComputeLocalToWorldTransform(time))
        points = np.array(theirs.GetPointsAttr().Get(time)) @ world[:3, :3] + world[3, :3]
        assert_same(ours[name], points, 1e-4)


def test_what_moves_is_read_at_the_time(tmp_path):
    scene = tmp_path / "moving.usda"
    stage = Usd.Stage.CreateNew(str(scene))
    UsdGeom.SetStageMetersPerUnit(stage, 1)
    UsdGeom.SetStageUpAxis(stage, "Y")
    parent = UsdGeom.Xform.Define(stage, "/Parent")
    turn, move = parent.AddRotateXYZOp(), parent.AddTranslateOp()
    turn.Set((0, 0, 0), 0)
    turn.Set((0, 90, 30), 20)
    move.Set((1, 0, 0))
    made = mesh(stage, "/Parent/Quad", [], [4], [0, 1, 2, 3])
    made.GetPointsAttr().Set([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], 0)
    made.GetPointsAttr().Set([(0, 0, 0), (2, 0, 0), (2, 3, 0), (0, 3, 1)], 10)
    hidden = mesh(stage, "/Parent/Late", [(0, 0, 0), (1, 0, 0), (0, 1, 0)], [3], [0, 1, 2])
    hidden.GetVisibilityAttr().Set("invisible", 0)
    hidden.GetVisibilityAttr().Set("inherited", 8)
    stage.GetRootLayer().Save()
    for time in [-3, 5, 7.5, 30]:
        ours = unwrapped(scene, tmp_path / "out", "--time", time)
        world = np.array(made.ComputeLocalToWorldTransform(time))
        points = np.array(made.GetPointsAttr().Get(time)) @ world[:3, :3] + world[3, :3]
        assert_same(ours["Quad"], points, 1e-5)
        assert ("Late" in ours) == (time >= 8)


def test_value_clips_are_read_at_the_time(tmp_path):
    """Samples in a file of their own, offset in time."""
    clip = tmp_path / "clip.usda"
    clip.write_text(
        '#usda 1.0\nover "Clip"\n{\n    over "Quad"\n    {\n        point3f[] points.timeSamples = {\n'
        "            100: [(0, 0, 0), (1, 0, 0), (1, 1, 0)],\n            110: [(0, 0, 5), (4, 0, 0), (1, 3, 0)],\n"
        "        }\n    }\n}\n"
    )
    scene = tmp_path / "clips.usda"
    stage = Usd.Stage.CreateNew(str(scene))
    UsdGeom.SetStageMetersPerUnit(stage, 1)
    UsdGeom.SetStageUpAxis(stage, "Y")
    model = UsdGeom.Xform.Define(stage, "/Model")
    made = mesh(stage, "/Model/Quad", [], [3], [0, 1, 2])
    made.GetPointsAttr().Clear()
    clips = Usd.ClipsAPI(model.GetPrim())
    clips.SetClipAssetPaths(["./clip.usda"])
    clips.SetClipPrimPath("/Clip")
    clips.SetClipActive([(0, 0)])
    clips.SetClipTimes([(0, 100), (20, 110)])
    clips.SetClipManifestAssetPath("./clip.usda")
    stage.GetRootLayer().Save()
    stage = Usd.Stage.Open(str(scene))
    for time in [0, 5, 20]:
        points = UsdGeom.Mesh(stage.GetPrimAtPath("/Model/Quad")).GetPointsAttr().Get(time)
        assert_same(unwrapped(scene, tmp_path / "out", "--time", time)["Quad"], points, 1e-5)


CAGES = {
    "cube": {"creases": [], "corners": []},
    "creased": {"creases": [[0, 1, 10.0], [1, 3, 10.0], [3, 2, 10.0], [2, 0, 10.0]], "corners": []},
    "soft": {"creases": [[0, 1, 2.5], [4, 5, 0.7]], "corners": []},
    "open": {"creases": [], "corners": [], "left_out": [5]},
}


def cage(name: str) -> dict:
    """A skewed cube with a prism of triangles and a pentagon on it: irregular vertices of many kinds."""
    points = [[x * (1 + 0.2 * y), y, z + 0.3 * x] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)]
    faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
    given = CAGES[name]
    faces = [f for i, f in enumerate(faces) if i not in given.get("left_out", [])]
    # One quad as two triangles, another around a point in its middle.
    a, b, c, d = faces.pop(0)
    faces += [[a, b, c], [a, c, d]]
    a, b, c, d = faces.pop(0)
    points.append([1.6, 0.1, 0.2])
    faces += [[a, b, 8, d], [b, c, d, 8]]
    return {"points": points, "faces": faces, "creases": given["creases"]}


@pytest.mark.parametrize("name", CAGES)
@pytest.mark.parametrize("levels", [1, 3])
def test_subdivision_is_that_of_opensubdiv(name, levels, tmp_path, blender):
    """Blender's modifier on its way to the limit surface, boundary corners kept, is OpenSubdiv's evaluation."""
    given = cage(name)
    scene = tmp_path / f"{name}.usda"
    stage = Usd.Stage.CreateNew(str(scene))
    UsdGeom.SetStageMetersPerUnit(stage, 1)
    UsdGeom.SetStageUpAxis(stage, "Y")
    corners = [p for f in given["faces"] for p in f]
    made = mesh(stage, "/cage", given["points"], [len(f) for f in given["faces"]], corners)
    made.GetSubdivisionSchemeAttr().Set("catmullClark")
    made.CreateCreaseIndicesAttr([p for a, b, _ in given["creases"] for p in (a, b)])
    made.CreateCreaseLengthsAttr([2] * len(given["creases"]))
    made.CreateCreaseSharpnessesAttr([s for _, _, s in given["creases"]])
    stage.GetRootLayer().Save()
    ours = unwrapped(scene, tmp_path / "out", "--subdivide", levels)["cage"]
    question = tmp_path / "cage.json"
    question.write_text(json.dumps(given | {"levels": levels}))
    theirs = np.array(blender("subdivide.py", question)["points"])
    assert len(ours) == len(theirs)
    # What stays sharp for a few levels more counts as sharp: its limit is met as refinement goes on.
    tolerance = {1: 0.1, 3: 0.02}[levels] if name == "soft" else 1e-4
    assert_same(ours, theirs, tolerance)


SHAPES = """#usda 1.0
(
    metersPerUnit = 1
    upAxis = "Y"
    defaultPrim = "World"
)
class Xform "_Tree" {
    def Cone "crown" {
        double height = 2
        double radius = 0.5
    }
}
def Xform "World" (
    prepend variantSets = "roof"
    variants = {
        string roof = "none"
    }
)
{
    variantSet "roof" = {
        "none" { }
        "flat" {
            def Cube "roof" {
                double size = 1
                double3 xformOp:translate = (0, 4, 0)
                uniform token[] xformOpOrder = ["xformOp:translate"]
            }
        }
    }
    def Material "red" {
        token outputs:surface.connect = </World/red/s.outputs:surface>
        def Shader "s" {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = (1, 0, 0)
            token outputs:surface
        }
    }
    def Plane "floor" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {
        double width = 8
        double length = 8
        uniform token axis = "Y"
        rel material:binding = </World/red>
    }
    def Sphere "ball" {
        double radius = 0.5
        double3 xformOp:translate = (2, 1, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Mesh "soft" {
        int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
        int[] faceVertexIndices = [0, 4, 6, 2, 1, 3, 7, 5, 0, 1, 5, 4, 2, 6, 7, 3, 0, 2, 3, 1, 4, 5, 7, 6]
        point3f[] points = [(-1, 1, -1), (1, 1, -1), (-1, 3, -1), (1, 3, -1), (-1, 1, 1), (1, 1, 1), (-1, 3, 1), (1, 3, 1)]
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] ( interpolation = "faceVarying" )
        int[] primvars:st:indices = [0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3]
        float[] primvars:age = [1, 2, 3, 4, 5, 6] ( interpolation = "uniform" )
        double3 xformOp:translate = (-2, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def GeomSubset "top" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [3]
            rel material:binding = </World/red>
        }
    }
    def Xform "tree_a" (
        instanceable = true
        prepend inherits = </_Tree>
    )
    {
        double3 xformOp:translate = (0, 2, 3)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Xform "tree_b" (
        instanceable = true
        prepend inherits = </_Tree>
    )
    {
        double3 xformOp:translate = (3, 2, 3)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def PointInstancer "stones" {
        int[] protoIndices = [0, 0, 0]
        point3f[] positions = [(-3, 0.2, -3), (0, 0.2, -3), (3, 0.2, -3)]
        int64[] invisibleIds = [1]
        rel prototypes = </World/stones/stone>
        def Sphere "stone" {
            double radius = 0.2
        }
    }
}
"""


def test_meshes_stand_in_for_shapes_and_refined_surfaces(tmp_path, bake):
    scene = tmp_path / "shapes.usda"
    scene.write_text(SHAPES)
    chosen = ["--subdivide", "2", "--variant", "/World:roof=flat"]
    done = bake(scene, "--quality", "draft", "--resolution", "128", "--sky", "1,1,1", *chosen)
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    stage = Usd.Stage.Open(str(done.layer))
    gprims = [p for p in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()) if p.IsA(UsdGeom.Gprim)]
    names = sorted(p.GetPath().pathString for p in gprims)
    below = ["ball", "floor", "roof", "soft", "stones/stone", "tree_a/crown", "tree_b/crown"]
    assert names == [f"/World/{name}" for name in below]
    for prim in gprims:
        assert prim.IsA(UsdGeom.Mesh), f"{prim.GetPath()} is a {prim.GetTypeName()}"
        made = UsdGeom.Mesh(prim)
        corners = sum(made.GetFaceVertexCountsAttr().Get())
        points = len(made.GetPointsAttr().Get())
        valid, reason = UsdGeom.Mesh.ValidateTopology(
            made.GetFaceVertexIndicesAttr().Get(), made.GetFaceVertexCountsAttr().Get(), points
        )
        assert valid, reason
        wanted = {"constant": 1, "uniform": corners // 3, "vertex": points, "faceVarying": corners}
        assert len(made.GetNormalsAttr().Get()) == wanted[made.GetNormalsInterpolation()]
        for primvar in UsdGeom.PrimvarsAPI(prim).GetPrimvarsWithValues():
            values = primvar.ComputeFlattened()
            count = len(values) if primvar.GetTypeName().isArray else 1
            assert count == wanted[primvar.GetInterpolation()], primvar.GetName()
        assert np.array(UsdGeom.PrimvarsAPI(prim).GetPrimvar("st1").ComputeFlattened()).shape == (corners, 2)
        bound = UsdGeom.PointBased.ComputeExtent(made.GetPointsAttr().Get())
        assert np.allclose(bound, made.GetExtentAttr().Get())
    world = stage.GetPrimAtPath("/World")
    assert world.GetVariantSet("roof").GetVariantSelection() == "flat"
    soft = stage.GetPrimAtPath("/World/soft")
    assert len(UsdGeom.Mesh(soft).GetFaceVertexCountsAttr().Get()) == 6 * 16 * 2
    top = UsdGeom.Subset(stage.GetPrimAtPath("/World/soft/top")).GetIndicesAttr().Get()
    corner = np.array(UsdGeom.Mesh(soft).GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
    height = np.array(UsdGeom.Mesh(soft).GetPointsAttr().Get())[corner[list(top)]][..., 1]
    assert len(top) == 32 and height.min() > 2.4, "the subset's triangles are those of the top"
    floor = stage.GetPrimAtPath("/World/floor")
    assert UsdShade.MaterialBindingAPI(floor).ComputeBoundMaterial()[0].GetPath() == "/World/red"
    assert stage.GetPrimAtPath("/World/tree_a").IsInstance()
    assert stage.GetPrimAtPath("/World/tree_a").GetPrototype() == stage.GetPrimAtPath("/World/tree_b").GetPrototype()
    assert [str(d.commentary) for d in delegate.TakeUncoalescedDiagnostics()] == []
    # Read again from the layer, the stand-ins are the surfaces that they stand in for.
    assert areas(done.layer) == pytest.approx(areas(scene, *chosen), rel=1e-5)


def areas(scene: Path, *arguments) -> dict[str, float]:
    run = lumel("inspect", "--json", scene, *arguments)
    assert run.returncode == 0, run.stderr
    return {s["name"]: s["area"] for s in json.loads(run.stdout)["surfaces"]}


def page(done) -> np.ndarray:
    return read_page(next((done.folder / "lightmaps").glob("*.exr"))).rgb


def test_text_binary_and_package_give_the_same_bits(tmp_path, bake):
    text = tmp_path / "text" / "scene.usda"
    text.parent.mkdir()
    text.write_text(SHAPES)
    stage = Usd.Stage.Open(str(text))
    binary, package = tmp_path / "binary" / "scene.usdc", tmp_path / "package" / "scene.usdz"
    for path in [binary, package]:
        path.parent.mkdir()
    stage.GetRootLayer().Export(str(binary))
    assert UsdUtils.CreateNewUsdzPackage(str(binary), str(package))
    pages = [page(bake(s, "--quality", "draft", "--resolution", "64", "--sky", "1,1,1")) for s in [text, binary, package]]
    assert np.array_equal(pages[0], pages[1]) and np.array_equal(pages[0], pages[2])


def test_units_and_axis_change_nothing(tmp_path, bake):
    """Centimetres with Z up are metres with Y up."""
    metres = tmp_path / "metres.usda"
    metres.write_text(SHAPES)
    stage = Usd.Stage.CreateNew(str(tmp_path / "centimetres.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdGeom.SetStageUpAxis(stage, "Z")
    holder = UsdGeom.Xform.Define(stage, "/Holder")
    holder.AddRotateXOp().Set(90)
    holder.AddScaleOp().Set((100, 100, 100))
    stage.DefinePrim("/Holder/World").GetReferences().AddReference(str(metres))
    stage.GetRootLayer().Save()
    a, b = (page(bake(s, "--quality", "medium", "--resolution", "64", "--sky", "1,1,1")) for s in [metres, tmp_path / "centimetres.usda"])
    assert abs(a.mean() / b.mean() - 1) < 0.01


def nest(stage: Usd.Stage):
    """Point instancers in point instancers, native instances in both, all with transforms, ids and points left out."""
    leaf = stage.CreateClassPrim("/_Leaf")
    mesh(stage, "/_Leaf/m", [(0, 0, 0), (0.5, 0, 0), (0, 0.25, 0)], [3], [0, 1, 2]).AddTranslateOp().Set((0, 0, 0.1))
    twig = stage.CreateClassPrim("/_Twig")
    for i in range(2):
        inner = UsdGeom.Xform.Define(stage, f"/_Twig/leaf_{i}")
        inner.AddTranslateOp().Set((i, 0, 0))
        inner.AddRotateZOp().Set(20 * i)
        inner.GetPrim().GetInherits().AddInherit(leaf.GetPath())
        inner.GetPrim().SetInstanceable(True)
    outer = UsdGeom.PointInstancer.Define(stage, "/World/Outer")
    outer.AddRotateYOp().Set(40)
    inner = UsdGeom.PointInstancer.Define(stage, "/World/Outer/Inner")
    inner.AddTranslateOp().Set((0, 0.3, 0))
    native = UsdGeom.Xform.Define(stage, "/World/Outer/Twig")
    native.AddScaleOp().Set((1, 2, 1))
    native.GetPrim().GetInherits().AddInherit(twig.GetPath())
    native.GetPrim().SetInstanceable(True)
    outer.CreatePrototypesRel().SetTargets([inner.GetPath(), native.GetPath()])
    outer.CreateProtoIndicesAttr([0, 1, 0, 1])
    outer.CreatePositionsAttr([(0, 0, 0), (5, 0, 0), (10, 1, 0), (15, 0, 2)])
    # Floats: halves are not quite of unit length, and we make them so where usd-core takes them as they stand.
    outer.CreateOrientationsfAttr([Gf.Quatf(1), rotation((0, 0, 1), 30), rotation((0, 1, 0), 70), Gf.Quatf(1)])
    outer.CreateScalesAttr([(1, 1, 1), (2, 1, 1), (-1, 1, 1), (1, 1, 1)])
    outer.CreateIdsAttr([7, 8, 9, 10])
    outer.CreateInvisibleIdsAttr([10])
    stone = mesh(stage, "/World/Outer/Inner/stone", [(0, 0, 0), (0.1, 0, 0), (0, 0, 0.1)], [3], [0, 1, 2])
    stone.AddScaleOp().Set((1, 1, 3))
    inner.CreatePrototypesRel().SetTargets([stone.GetPath()])
    inner.CreateProtoIndicesAttr([0, 0, 0])
    inner.CreatePositionsAttr([(0, 0, 0), (1, 0, 0), (2, 0, 0)])
    inner.DeactivateId(1)
    for i in range(2):
        placed = UsdGeom.Xform.Define(stage, f"/World/twig_{i}")
        placed.AddTranslateOp().Set((0, 3, 4 * i))
        placed.GetPrim().GetInherits().AddInherit(twig.GetPath())
        placed.GetPrim().SetInstanceable(True)


def points_below(root: Usd.Prim, world: Gf.Matrix4d) -> list[np.ndarray]:
    """World points of all that is drawn at and below `root`, placed by `world`, each instance's own, by usd-core."""
    if UsdGeom.PointInstancer(root):
        instancer = UsdGeom.PointInstancer(root)
        prototypes = [root.GetStage().GetPrimAtPath(p) for p in instancer.GetPrototypesRel().GetTargets()]
        include, mask = UsdGeom.PointInstancer.IncludeProtoXform, UsdGeom.PointInstancer.ApplyMask
        places = instancer.ComputeInstanceTransformsAtTime(0, 0, include, mask)
        kept = instancer.ComputeMaskAtTime(0) or [True] * len(instancer.GetProtoIndicesAttr().Get())
        indices = [i for i, k in zip(instancer.GetProtoIndicesAttr().Get(), kept) if k]
        assert len(indices) == len(places)
        return [p for i, place in zip(indices, places) for p in points_below(prototypes[i], place * world)]
    found = []
    if UsdGeom.Mesh(root):
        points = np.array(UsdGeom.Mesh(root).GetPointsAttr().Get())
        found.append(points @ np.array(world)[:3, :3] + np.array(world)[3, :3])
    for child in root.GetFilteredChildren(Usd.TraverseInstanceProxies()):
        if child.IsDefined() and not child.IsAbstract():
            local = UsdGeom.Xformable(child).GetLocalTransformation() if UsdGeom.Xformable(child) else Gf.Matrix4d(1)
            found += points_below(child, local * world)
    return found


def test_nested_instances_stand_where_usd_core_has_them(tmp_path):
    # Binary: the reader's text parser knows no lists of inactive ids.
    scene = tmp_path / "nest.usdc"
    stage = Usd.Stage.CreateNew(str(scene))
    UsdGeom.SetStageMetersPerUnit(stage, 1)
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.Xform.Define(stage, "/World")
    nest(stage)
    stage.GetRootLayer().Save()
    theirs = points_below(stage.GetPseudoRoot(), Gf.Matrix4d(1))
    # Two inner instancers of two points, one twig of two leaves below the outer one; two twigs beside it.
    assert len(theirs) == 2 * 2 + 2 + 2 * 2
    run = lumel("unwrap", scene, "-o", tmp_path / "out", "--resolution", "256")
    assert run.returncode == 0, run.stderr
    doc = Document(tmp_path / "out" / "nest.glb")
    ours = []
    for node, world in doc.placed_nodes():
        if "mesh" in node:
            for primitive in doc.json["meshes"][node["mesh"]]["primitives"]:
                points = doc.accessor(primitive["attributes"]["POSITION"])
                ours.append(points @ world[:3, :3].T + world[:3, 3])
    assert len(ours) == len(theirs)
    assert_same(unique(np.concatenate(ours)), np.concatenate(theirs), 1e-4)
