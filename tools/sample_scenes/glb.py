"""A scene as GLB: flat-shaded, one node and one mesh for each surface that is not an instance."""

import json
import struct
from math import cos, radians, sin
from pathlib import Path

from .model import Material, Mesh, Scene, Vec3


def write(scene: Scene, path: Path) -> None:
    binary = bytearray()
    views: list[dict] = []
    accessors: list[dict] = []

    def accessor(rows: list, kind: str, bounds: bool = False) -> int:
        """Appends floats, or 16-bit indices for SCALAR, and returns the accessor's index."""
        indices = kind == "SCALAR"
        flat = rows if indices else [v for row in rows for v in row]
        data = struct.pack(f"<{len(flat)}{'H' if indices else 'f'}", *flat)
        binary.extend(b"\0" * (-len(binary) % 4))
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data), "target": 34963 if indices else 34962})
        binary.extend(data)
        entry = {"bufferView": len(views) - 1, "componentType": 5123 if indices else 5126, "count": len(rows), "type": kind}
        if bounds:
            # The bounds must be those of the 32-bit values stored.
            stored = [struct.unpack("<3f", struct.pack("<3f", *row)) for row in rows]
            entry["min"] = [min(r[k] for r in stored) for k in range(3)]
            entry["max"] = [max(r[k] for r in stored) for k in range(3)]
        accessors.append(entry)
        return len(accessors) - 1

    material_of = {m.name: i for i, m in enumerate(scene.materials)}
    nodes, meshes = [], []

    def primitive(mesh: Mesh) -> dict:
        positions, normals, triangles = [], [], []
        for face in mesh.faces:
            first = len(positions)
            positions += [mesh.points[i] for i in face]
            normals += [from_centre(mesh.points[i], mesh.smooth) for i in face] if mesh.smooth else [mesh.normal(face)] * len(face)
            for k in range(1, len(face) - 1):
                triangles += [first, first + k, first + k + 1]
        attributes = {"POSITION": accessor(positions, "VEC3", bounds=True), "NORMAL": accessor(normals, "VEC3")}
        if mesh.uvs:
            attributes["TEXCOORD_0"] = accessor(mesh.uvs, "VEC2")
        return {"attributes": attributes, "indices": accessor(triangles, "SCALAR"), "material": material_of[mesh.material]}

    for mesh in scene.meshes:
        nodes.append({"name": mesh.name, "mesh": len(meshes)})
        meshes.append({"name": mesh.name, "primitives": [primitive(mesh)]})
    for instances in scene.instances:
        for place in instances.places:
            half = radians(place.turn) / 2
            turned = {"translation": list(place.at), "rotation": [0.0, sin(half), 0.0, cos(half)], "scale": list(place.scale)}
            nodes.append({"name": place.name, "mesh": len(meshes)} | turned)
        meshes.append({"name": instances.name, "primitives": [primitive(part) for part in instances.parts]})
    textures = list(dict.fromkeys(m.texture for m in scene.materials if m.texture))
    materials, strengths = [], False
    for m in scene.materials:
        entry: dict = {
            "name": m.name,
            "pbrMetallicRoughness": {"baseColorFactor": [*m.albedo, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0},
        }
        if m.texture:
            entry["pbrMetallicRoughness"] |= {"baseColorFactor": [1.0] * 4, "baseColorTexture": texture(m, textures)}
        if m.double_sided:
            entry["doubleSided"] = True
        strength = max(m.emission)
        if strength > 0:
            entry["emissiveFactor"] = [v / strength for v in m.emission]
            if strength != 1:
                entry["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
                strengths = True
        entry["pbrMetallicRoughness"] |= m.looks.get("pbrMetallicRoughness", {})
        if extensions := m.looks.get("extensions"):
            entry["extensions"] = entry.get("extensions", {}) | extensions
        materials.append(entry)
    document: dict = {"asset": {"version": "2.0", "generator": "lumel tools/make_samples", "copyright": scene.comment}}
    transforms = any(m.transform for m in scene.materials)
    used = {"KHR_materials_emissive_strength": strengths, "KHR_texture_transform": transforms}
    used |= {name: True for m in scene.materials for name in m.looks.get("extensions", {})}
    if any(used.values()):
        document["extensionsUsed"] = [name for name, is_used in used.items() if is_used]
    if textures:
        # Texels as they are: filters of 8-bit textures differ between renderers, before and after the transfer curve.
        document["samplers"] = [{"magFilter": 9728, "minFilter": 9728}]
        document["textures"] = [{"source": k, "sampler": 0} for k in range(len(textures))]
        document["images"] = [{"uri": name} for name in textures]
    if scene.camera:
        c = scene.camera
        yfov = c.fov * 3.141592653589793 / 180
        document["cameras"] = [{"type": "perspective", "perspective": {"aspectRatio": c.aspect, "yfov": yfov, "znear": 0.01}}]
        nodes.append({"name": "camera", "camera": 0, "translation": list(c.eye)})
        if c.yaw or c.pitch:
            nodes[-1]["rotation"] = c.quaternion()
    for name, at, size, medium in scene.media:
        nodes.append({"name": name, "translation": list(at), "scale": list(size), "extras": {"lumel": {"medium": medium}}})
    document |= {
        "scene": 0,
        "scenes": [{"name": scene.name, "nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": meshes,
        "materials": materials,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary) + -len(binary) % 4}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    binary.extend(b"\0" * (-len(binary) % 4))
    size = 12 + 8 + len(text) + 8 + len(binary)
    path.write_bytes(
        struct.pack("<4sIIII", b"glTF", 2, size, len(text), 0x4E4F534A) + text
        + struct.pack("<II", len(binary), 0x004E4942) + bytes(binary)
    )


def from_centre(point: Vec3, centre: Vec3) -> Vec3:
    """The unit vector from the middle of a ball to a point on it."""
    way = [p - c for p, c in zip(point, centre)]
    length = sum(v * v for v in way) ** 0.5
    return tuple(v / length for v in way)


def texture(material: Material, textures: list[str]) -> dict:
    """The slot of a material's texture."""
    slot: dict = {"index": textures.index(material.texture)}
    if t := material.transform:
        own = {"offset": list(t.offset), "rotation": t.rotation, "scale": list(t.scale)}
        slot["extensions"] = {"KHR_texture_transform": own}
    return slot
