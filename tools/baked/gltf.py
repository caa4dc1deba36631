"""A .glb or .gltf file with its buffers, accessors and pictures."""

import base64
import io
import json
import struct
import urllib.parse
from pathlib import Path

import numpy as np

COMPONENT = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


class Document:
    """The JSON of a glTF file, and access to what it refers to."""

    def __init__(self, path: Path | str):
        self.path = Path(path)
        self.chunks: list[bytes] = []
        data = self.path.read_bytes()
        if data[:4] == b"glTF":
            at = 12
            while at + 8 <= len(data):
                size, kind = struct.unpack_from("<II", data, at)
                body = data[at + 8 : at + 8 + size]
                if kind == 0x4E4F534A:
                    self.json = json.loads(body)
                elif kind == 0x004E4942:
                    self.chunks.append(body)
                at += 8 + size
        else:
            self.json = json.loads(data)
        self.buffers = [self._bytes(b) for b in self.json.get("buffers", [])]
        self._images: dict[int, np.ndarray] = {}

    def _bytes(self, holder: dict) -> bytes:
        if "uri" not in holder:
            return self.chunks[0]
        uri = holder["uri"]
        if uri.startswith("data:"):
            return base64.b64decode(uri.split(",", 1)[1])
        return (self.path.parent / urllib.parse.unquote(uri)).read_bytes()

    def _rows(self, view: int, offset: int, count: int, width: int, kind: np.dtype) -> np.ndarray:
        v = self.json["bufferViews"][view]
        size = width * kind.itemsize
        start = v.get("byteOffset", 0) + offset
        raw = np.frombuffer(self.buffers[v["buffer"]], np.uint8)
        at = start + np.arange(count)[:, None] * v.get("byteStride", size) + np.arange(size)[None]
        return raw[at].reshape(-1).view(kind).reshape(count, width)

    def accessor(self, index: int) -> np.ndarray:
        """Rows of an accessor: floats where they are floats or normalized integers, else integers."""
        a = self.json["accessors"][index]
        count, width, kind = a["count"], WIDTH[a["type"]], np.dtype(COMPONENT[a["componentType"]])
        if "bufferView" in a:
            out = self._rows(a["bufferView"], a.get("byteOffset", 0), count, width, kind)
        else:
            out = np.zeros((count, width), kind)
        if "sparse" in a:
            s = a["sparse"]
            where, what = s["indices"], s["values"]
            index_kind = np.dtype(COMPONENT[where["componentType"]])
            rows = self._rows(where["bufferView"], where.get("byteOffset", 0), s["count"], 1, index_kind).ravel()
            out = out.copy()
            out[rows] = self._rows(what["bufferView"], what.get("byteOffset", 0), s["count"], width, kind)
        if a.get("normalized"):
            return np.maximum(out / np.iinfo(kind).max, -1)
        return out.astype(float) if kind.kind == "f" else out

    def triangles(self, primitive: dict) -> np.ndarray | None:
        """(T, 3) vertex indices of a primitive; none where it is not made of triangles."""
        mode = primitive.get("mode", 4)
        if mode not in (4, 5, 6) or "POSITION" not in primitive["attributes"]:
            return None
        if "indices" in primitive:
            i = self.accessor(primitive["indices"]).ravel().astype(int)
        else:
            i = np.arange(self.json["accessors"][primitive["attributes"]["POSITION"]]["count"])
        if mode == 4:
            return i[: len(i) // 3 * 3].reshape(-1, 3)
        if mode == 6:
            return np.stack([np.full(max(len(i) - 2, 0), i[0]), i[1:-1], i[2:]], 1)
        t = np.stack([i[:-2], i[1:-1], i[2:]], 1)
        t[1::2] = t[1::2, [1, 0, 2]]
        return t

    def placed_nodes(self):
        """Pairs of node and its world matrix, for the nodes of the default scene."""
        scenes = self.json.get("scenes", [])
        roots = scenes[self.json.get("scene", 0)].get("nodes", []) if scenes else []
        stack = [(i, np.eye(4)) for i in reversed(roots)]
        while stack:
            i, parent = stack.pop()
            node = self.json["nodes"][i]
            world = parent @ local_matrix(node)
            stack += [(c, world) for c in reversed(node.get("children", []))]
            yield node, world

    def image(self, index: int) -> np.ndarray:
        """RGBA of picture `index` as stored, 0..1, row 0 at the top."""
        if index not in self._images:
            from PIL import Image

            entry = self.json["images"][index]
            if "bufferView" in entry:
                v = self.json["bufferViews"][entry["bufferView"]]
                start = v.get("byteOffset", 0)
                data = self.buffers[v["buffer"]][start : start + v["byteLength"]]
            else:
                data = self._bytes(entry)
            self._images[index] = np.asarray(Image.open(io.BytesIO(data)).convert("RGBA"), np.float32) / 255
        return self._images[index]

    def lumel(self) -> dict:
        """What the baker wrote about the whole file."""
        return (self.json["asset"].get("extras") or {}).get("lumel") or {}


def local_matrix(node: dict) -> np.ndarray:
    """Parent from node."""
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    m = np.eye(4)
    x, y, z, w = node.get("rotation", [0, 0, 0, 1])
    m[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    m[:3, :3] = m[:3, :3] @ np.diag(node.get("scale", [1, 1, 1]))
    m[:3, 3] = node.get("translation", [0, 0, 0])
    return m
