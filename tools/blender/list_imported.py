"""list_imported.py FILE: imports a file and prints what Blender made of each mesh: UV maps, colour attributes, their ranges."""

import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import path_tracer


def attribute_of(data) -> dict:
    """Domain, type and range of an attribute."""
    name = {"FLOAT_VECTOR": "vector", "FLOAT_COLOR": "color", "BYTE_COLOR": "color", "FLOAT2": "vector", "FLOAT": "value"}.get(data.data_type)
    flat = [0.0]
    if name and len(data.data):
        first = getattr(data.data[0], name)
        width = len(first) if hasattr(first, "__len__") else 1
        flat = [0.0] * (len(data.data) * width)
        data.data.foreach_get(name, flat)
    return {"domain": data.domain, "type": data.data_type, "count": len(data.data), "min": min(flat), "max": max(flat)}


def main() -> None:
    path_tracer.open_scene(Path(sys.argv[1]))
    meshes = {}
    for o in path_tracer.mesh_objects():
        mesh = o.data
        meshes[o.name] = {
            "corners": len(mesh.loops),
            "uvs": [layer.name for layer in mesh.uv_layers],
            "active": mesh.uv_layers.active.name if mesh.uv_layers.active else None,
            "attributes": {a.name: attribute_of(a) for a in mesh.attributes if not a.name.startswith(".")},
            "lumel": "lumel" in o.keys(),
        }
    print(json.dumps({"meshes": meshes}))


main()
