"""A room in which all that can go astray between a baked file and an engine can be seen: textures that are scaled, turned and moved,
sheets seen from the front and from the back, and instances of one mesh of two materials, one of them mirrored. For checks; metres, Y up.
"""

from math import pi
from pathlib import Path

from . import corners, glb, png
from .model import Builder, Camera, Instances, Material, Mesh, Place, Scene, Transform, Vec3

ROOM = (4.0, 2.5, 3.2)
TEXTURE = "tiles.png"
SIDE = 16  # texels of the texture, so few that no mip level below the first is read


def tiles() -> bytes:
    """Four colours around a corner, each with a mark of its own: turned or mirrored it looks another."""
    palette = [(200, 90, 60), (70, 140, 200), (220, 200, 120), (90, 160, 90), (240, 240, 240)]
    rows = []
    for y in range(SIDE):
        row = bytearray(2 * (y >= SIDE // 2) + (x >= SIDE // 2) for x in range(SIDE))
        row[2 : 3 + y % (SIDE // 2)] = bytes([4]) * (1 + y % (SIDE // 2))
        rows.append(bytes(row))
    return png.paletted(SIDE, rows, palette)


def textured(mesh: Mesh, material: str) -> Mesh:
    """The texture once across every face of four corners."""
    mesh.material, mesh.uvs = material, [(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)] * len(mesh.faces)
    return mesh


def sheet(name: str, *face: Vec3) -> Mesh:
    return textured(Builder(name, "").face(*face).mesh(), "screen")


def crate() -> list[Mesh]:
    """About its own origin on the floor: sides of one material, a lid of another."""
    sides = Builder("sides", "").box((-0.3, 0, -0.3), (0.3, 0.5, 0.3), without="-y +y").mesh()
    lid = Builder("lid", "cloth").face((-0.3, 0.5, -0.3), (-0.3, 0.5, 0.3), (0.3, 0.5, 0.3), (0.3, 0.5, -0.3)).mesh()
    return [textured(sides, "boards"), textured(lid, "cloth")]


def scene() -> Scene:
    walls = corners.shell(*ROOM)
    for mesh in walls:
        if mesh.name in ("floor", "back", "left"):
            textured(mesh, f"{mesh.name}_tiles")
    screens = [
        sheet("screen_front", (0.5, 0.9, 0.7), (1.2, 0.9, 0.9), (1.2, 1.7, 0.9), (0.5, 1.7, 0.7)),
        sheet("screen_back", (3.5, 0.9, 0.7), (2.8, 0.9, 0.9), (2.8, 1.7, 0.9), (3.5, 1.7, 0.7)),
    ]
    lamps = [corners.lamp("lamp", (1.2, 2.45, 1.2), 0.3), corners.lamp("glow", (3.3, 2.45, 2.2), 0.15)]
    lamps[1].material = "glow"
    places = [
        Place("crate_1", (0.8, 0, 1.3), 20.0),
        Place("crate_2", (2.0, 0, 0.9), -35.0, (0.8, 1.5, 0.8)),
        Place("crate_3", (3.1, 0, 1.5), 10.0, (-1.0, 1.0, 1.0)),
    ]
    materials = [
        *corners.MATERIALS,
        Material("lamp", (0.0, 0.0, 0.0), emission=(20.0, 18.0, 14.0)),
        Material("glow", (0.0, 0.0, 0.0), emission=(4.0, 12.0, 30.0)),
        Material("floor_tiles", (1, 1, 1), texture=TEXTURE, transform=Transform((0.1, 0.25), pi / 6, (3.0, 2.0))),
        Material("back_tiles", (1, 1, 1), texture=TEXTURE, transform=Transform((0.5, 0.0), 0.0, (2.0, -1.0))),
        Material("left_tiles", (1, 1, 1), texture=TEXTURE, transform=Transform((0.0, 1.0), pi / 2, (1.0, 1.5))),
        Material("boards", (1, 1, 1), texture=TEXTURE),
        Material("screen", (1, 1, 1), texture=TEXTURE, transform=Transform(scale=(1.5, 1.0)), double_sided=True),
    ]
    camera = Camera.towards((2.0, 1.5, 3.15), (2.0, 0.95, 0.0), 82.0, 1.0)
    comment = "A room to look at in engines. Metres, Y up. CC0."
    return Scene("gallery", comment, materials, [*walls, *screens, *lamps], camera, [Instances("crate", crate(), places)])


def write(folder: Path) -> Path:
    """Writes the scene and its texture; returns the GLB."""
    (folder / TEXTURE).write_bytes(tiles())
    glb.write(scene(), folder / "gallery.glb")
    return folder / "gallery.glb"
