"""What the tools that show bakes make of files: instances where they stand, and a word on pages that they can't read."""

import json
import struct
import subprocess
import sys

import numpy as np
from baked import triangles
from conftest import TOOLS


def instanced(path):
    """A .gltf of one triangle that is drawn twice: moved up by one, and turned about z and doubled."""
    rows = {
        "POSITION": [[0, 0, 0], [1, 0, 0], [0, 1, 0]],
        "TEXCOORD_1": [[0, 0], [1, 0], [0, 1]],
        "TRANSLATION": [[0, 1, 0], [0, 0, 0]],
        "ROTATION": [[0, 0, 0, 1], [0, 0, 0.5**0.5, 0.5**0.5]],
        "SCALE": [[1, 1, 1], [2, 2, 2]],
        "_LUMEL_RECT": [[0.5, 0.5, 0.25, 0], [0, 0, 0, 0]],
        "_LUMEL_PAGE": [[0], [0]],
    }
    data, views, accessors = b"", [], []
    for values in rows.values():
        part = b"".join(struct.pack(f"<{len(v)}f", *v) for v in values)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(part)})
        kind = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}[len(values[0])]
        accessors.append({"bufferView": len(accessors), "componentType": 5126, "count": len(values), "type": kind})
        data += part
    number = {name: k for k, name in enumerate(rows)}
    own = {name: number[name] for name in rows if name not in ("POSITION", "TEXCOORD_1")}
    mesh = {"primitives": [{"attributes": {name: number[name] for name in ("POSITION", "TEXCOORD_1")}}]}
    node = {
        "name": "leaf",
        "mesh": 0,
        "extensions": {"EXT_mesh_gpu_instancing": {"attributes": own}},
        "extras": {"lumel": {"texCoord": 1}},
    }
    (path.parent / "a.bin").write_bytes(data)
    buffers = [{"uri": "a.bin", "byteLength": len(data)}]
    document = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [node], "meshes": [mesh]}
    path.write_text(json.dumps(document | {"buffers": buffers, "bufferViews": views, "accessors": accessors}))


def test_instances_stand_where_they_are_drawn(tmp_path):
    path = tmp_path / "a.gltf"
    instanced(path)
    found = triangles.load(path)
    assert found.names == ["leaf[0]", "leaf[1]"]
    np.testing.assert_allclose(found.position[0], [[0, 1, 0], [1, 1, 0], [0, 2, 0]], atol=1e-6)
    np.testing.assert_allclose(found.position[1], [[0, 0, 0], [0, 2, 0], [-2, 0, 0]], atol=1e-6)
    assert found.page.tolist() == [0, -1]
    np.testing.assert_allclose(found.page_uv[0], [[0.25, 0], [0.75, 0], [0.25, 0.5]])


def test_a_preview_of_other_pages_says_what_to_do(tmp_path):
    (tmp_path / "lightmaps").mkdir()
    (tmp_path / "lightmaps" / "a_0.half.ktx2").write_bytes(b"")
    run = subprocess.run([sys.executable, TOOLS / "preview", tmp_path], capture_output=True, text=True)
    assert run.returncode != 0 and ".ktx2" in run.stderr and "--encoding exr" in run.stderr, run.stderr
