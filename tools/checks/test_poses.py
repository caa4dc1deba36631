"""Skins and animations: the baker's posed geometry is what an evaluation of its own, and Blender's importer, give."""

import json

import numpy as np
import pytest
from baked.gltf import Document, local_matrix
from conftest import lumel

TIMES = [0.0, 0.4, 1.3, 2.0]


def inspect(scene, time):
    at = [] if time is None else ["--time", time]
    run = lumel("inspect", scene, "--json", *at)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


def animate(document: Document, time: float):
    """Writes the first animation's values at `time` into the nodes: linear channels of translation, rotation and scale."""
    animation = document.json["animations"][0]
    for channel in animation["channels"]:
        sampler = animation["samplers"][channel["sampler"]]
        assert sampler.get("interpolation", "LINEAR") == "LINEAR"
        t, values = document.accessor(sampler["input"]).ravel(), document.accessor(sampler["output"])
        k = int(np.clip(np.searchsorted(t, time, "right") - 1, 0, len(t) - 2))
        u = np.clip((time - t[k]) / (t[k + 1] - t[k]), 0, 1)
        a, b = values[k], values[k + 1]
        if channel["target"]["path"] == "rotation":
            b = b if a @ b >= 0 else -b
            angle = np.arccos(np.clip(a @ b, -1, 1))
            mixed = a if angle < 1e-6 else (np.sin((1 - u) * angle) * a + np.sin(u * angle) * b) / np.sin(angle)
        else:
            mixed = a + (b - a) * u
        document.json["nodes"][channel["target"]["node"]][channel["target"]["path"]] = mixed.tolist()


def posed(scene, time):
    """Corners (T, 3, 3) of the scene's triangles in world space, skins applied."""
    document = Document(scene)
    if time is not None:
        animate(document, time)
    nodes = document.json["nodes"]
    world = {}

    def walk(i, parent):
        world[i] = parent @ local_matrix(nodes[i])
        for child in nodes[i].get("children", []):
            walk(child, world[i])

    for root in document.json["scenes"][document.json.get("scene", 0)]["nodes"]:
        walk(root, np.eye(4))
    out = []
    for i, node in enumerate(nodes):
        for primitive in document.json["meshes"][node["mesh"]]["primitives"] if "mesh" in node and i in world else []:
            attributes = primitive["attributes"]
            position = document.accessor(attributes["POSITION"])
            position = np.concatenate([position, np.ones((len(position), 1))], 1)
            if "skin" in node:
                skin = document.json["skins"][node["skin"]]
                inverse = document.accessor(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
                joints = np.stack([world[j] for j in skin["joints"]]) @ inverse
                index, weight = document.accessor(attributes["JOINTS_0"]), document.accessor(attributes["WEIGHTS_0"])
                blend = (joints[index] * (weight / weight.sum(1, keepdims=True))[..., None, None]).sum(1)
                points = np.einsum("vij,vj->vi", blend, position)[:, :3]
            else:
                points = (position @ world[i].T)[:, :3]
            out.append(points[document.triangles(primitive)])
    return np.concatenate(out)


def same(got, bounds, area):
    size = np.ptp(np.array(bounds), axis=0).max()
    assert np.abs(np.array(got["bounds"]) - bounds).max() < 2e-5 * size, f"{got['bounds']} is not {bounds}"
    assert abs(got["area"] / area - 1) < 1e-4


FILES = ["khr_core_features/RiggedSimple/glTF/RiggedSimple.gltf", "khr_milk_truck/models/CesiumMilkTruck.glb"]


@pytest.mark.parametrize("time", [None, *TIMES])
@pytest.mark.parametrize("name", FILES)
def test_poses_agree_with_an_evaluation_in_numpy(name, time, scenes):
    corners = posed(scenes / name, time)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat = corners.reshape(-1, 3)
    same(inspect(scenes / name, time), [flat.min(0), flat.max(0)], np.linalg.norm(cross, axis=1).sum() / 2)


# Between keys Blender mixes the components of rotations, so it is asked at keys.
KEYS = [(FILES[0], 0.0), (FILES[0], 25 / 24), (FILES[0], 50 / 24), (FILES[1], 0.0), (FILES[1], 0.5)]


@pytest.mark.parametrize(("name", "time"), KEYS)
def test_poses_agree_with_blender(name, time, scenes, blender):
    theirs = blender("posed.py", scenes / name, time)
    same(inspect(scenes / name, time), theirs["bounds"], theirs["area"])


def test_the_skin_does_bend(scenes):
    """That the checks above can fail: the pose changes with time."""
    bounds = [np.array(inspect(scenes / FILES[0], t)["bounds"]) for t in (None, *TIMES)]
    assert max(np.abs(b - bounds[0]).max() for b in bounds[1:]) > 0.3


COMPRESSED = ["gltftransform_codecs/extensions/test/in/BoxMeshopt.glb", "gltftransform_codecs/extensions/test/in/BoxMeshopt.gltf"]


@pytest.mark.parametrize("name", [*FILES, *COMPRESSED])
def test_what_is_written_of_them_is_valid(name, scenes, bake, gltf_errors):
    done = bake(scenes / name, "--quality", "draft", "--resolution", "128", "--sky", "1")
    assert gltf_errors(done.glb, done.vertex_glb) == {done.glb.name: [], done.vertex_glb.name: []}
