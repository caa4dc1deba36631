"""What is written of every kind of glTF input passes the Khronos validator, where the input does."""

import base64
import io
import json

import numpy as np
import pytest
from baked.gltf import Document
from PIL import Image

POSITIONS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4")
UVS = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], "<f4")
TRIANGLES = np.array([0, 1, 2, 0, 2, 3], "<u2")


def uri(data: bytes, mime: str) -> str:
    return f"data:{mime};base64,{base64.b64encode(data).decode()}"


def picture(kind: str, color=(200, 120, 40)) -> dict:
    out = io.BytesIO()
    Image.new("RGB", (4, 4), color).save(out, kind, lossless=True)
    return {"uri": uri(out.getvalue(), f"image/{kind.lower()}"), "mimeType": f"image/{kind.lower()}"}


class Scene:
    """A textured square, to which a case adds what it is about."""

    def __init__(self):
        self.bin = b""
        self.json = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {}, "material": 0}]}],
            "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0, "baseColorTexture": {"index": 0}}}],
            "textures": [{"source": 0}],
            "images": [picture("PNG")],
            "accessors": [],
            "bufferViews": [],
        }
        self.primitive = self.json["meshes"][0]["primitives"][0]
        self.primitive["attributes"] = {
            "POSITION": self.accessor(POSITIONS, "VEC3", 34962, bounds=True),
            "TEXCOORD_0": self.accessor(UVS, "VEC2", 34962),
        }
        self.primitive["indices"] = self.accessor(TRIANGLES, "SCALAR", 34963)

    def accessor(self, rows: np.ndarray, kind: str, target=None, bounds=False, **keys) -> int:
        self.bin += bytes(-len(self.bin) % 4)
        view = {"buffer": 0, "byteOffset": len(self.bin), "byteLength": rows.nbytes} | ({"target": target} if target else {})
        self.bin += rows.tobytes()
        self.json["bufferViews"].append(view)
        code = {"f4": 5126, "u1": 5121, "u2": 5123}[rows.dtype.str[1:]]
        entry = {"bufferView": len(self.json["bufferViews"]) - 1, "componentType": code, "count": len(rows), "type": kind}
        if bounds:
            flat = rows.reshape(len(rows), -1)
            entry |= {"min": flat.min(0).tolist(), "max": flat.max(0).tolist()}
        self.json["accessors"].append(entry | keys)
        return len(self.json["accessors"]) - 1

    def use(self, *names: str, required=False):
        self.json.setdefault("extensionsUsed", []).extend(names)
        if required:
            self.json.setdefault("extensionsRequired", []).extend(names)

    def save(self, path):
        self.json["buffers"] = [{"byteLength": len(self.bin), "uri": uri(self.bin, "application/octet-stream")}]
        path.write_text(json.dumps(self.json))
        return path


def webp(scene: Scene):
    scene.use("EXT_texture_webp", required=True)
    scene.json["images"] = [picture("WEBP")]
    scene.json["textures"] = [{"extensions": {"EXT_texture_webp": {"source": 0}}}]


def variants(scene: Scene):
    scene.use("KHR_materials_variants")
    scene.json["extensions"] = {"KHR_materials_variants": {"variants": [{"name": "day"}, {"name": "night"}]}}
    scene.json["materials"].append({"name": "dark", "emissiveFactor": [1, 0, 0]})
    mappings = [{"material": 0, "variants": [0]}, {"material": 1, "variants": [1]}]
    scene.primitive["extensions"] = {"KHR_materials_variants": {"mappings": mappings}}


def glass(scene: Scene):
    scene.use("KHR_materials_transmission", "KHR_materials_volume")
    scene.json["materials"][0]["extensions"] = {
        "KHR_materials_transmission": {"transmissionFactor": 0.5, "transmissionTexture": {"index": 0}},
        "KHR_materials_volume": {"thicknessFactor": 0.1, "attenuationDistance": 1, "attenuationColor": [0.5, 1, 1]},
    }


def skinned_and_morphed(scene: Scene):
    attributes = scene.primitive["attributes"]
    attributes["JOINTS_0"] = scene.accessor(np.tile(np.array([0, 1, 0, 0], "u1"), (4, 1)), "VEC4", 34962)
    weights = np.array([[1, 0, 0, 0], [1, 0, 0, 0], [0.5, 0.5, 0, 0], [0, 1, 0, 0]], "<f4")
    attributes["WEIGHTS_0"] = scene.accessor(weights, "VEC4", 34962)
    lift = scene.accessor(np.tile(np.array([0, 0, 1], "<f4"), (4, 1)), "VEC3", 34962, bounds=True)
    scene.primitive["targets"] = [{"POSITION": lift}]
    scene.json["meshes"][0]["weights"] = [0.25]
    scene.json["nodes"] = [{"mesh": 0, "skin": 0}, {"children": [2]}, {"translation": [0, 1, 0]}]
    scene.json["scenes"][0]["nodes"] = [0, 1]
    inverse = np.tile(np.eye(4, dtype="<f4"), (2, 1, 1))
    scene.json["skins"] = [{"joints": [1, 2], "inverseBindMatrices": scene.accessor(inverse, "MAT4")}]
    times = scene.accessor(np.array([0, 1], "<f4"), "SCALAR", bounds=True)
    moved = scene.accessor(np.array([[0, 1, 0], [0, 2, 0]], "<f4"), "VEC3")
    grown = scene.accessor(np.array([0, 1], "<f4"), "SCALAR")
    channels = [{"sampler": 0, "target": {"node": 2, "path": "translation"}}, {"sampler": 1, "target": {"node": 0, "path": "weights"}}]
    scene.json["animations"] = [{"channels": channels, "samplers": [{"input": times, "output": moved}, {"input": times, "output": grown}]}]


CASES = {
    "webp": (webp, []),
    "variants": (variants, ["--variant", "night"]),
    "glass": (glass, []),
    "rest": (skinned_and_morphed, []),
    "posed": (skinned_and_morphed, ["--time", "0.5"]),
}


@pytest.mark.parametrize("name", CASES)
def test_what_is_written_is_valid(name, bake, gltf_errors, tmp_path):
    add, options = CASES[name]
    scene = Scene()
    add(scene)
    path = scene.save(tmp_path / f"{name}.gltf")
    assert gltf_errors(path) == {path.name: []}, "the input itself"
    done = bake(path, "--quality", "draft", "--resolution", "64", "--sky", "1", *options)
    assert gltf_errors(done.glb, done.vertex_glb) == {done.glb.name: [], done.vertex_glb.name: []}
    before, after = scene.json, Document(done.glb).json
    for key in ("skins", "animations", "materials", "extensionsRequired"):
        assert after.get(key) == before.get(key), key
