"""A table in a room: contact shadows, thin legs, penumbrae, a floor whose two halves are meshed apart.

4.0 x 2.6 x 3.4 m. The lamp is small and off the middle, so that the shadows of table, shelf and stool fall where one sees them.
"""

from sample_scenes.model import Builder, Camera, Material, Scene

from . import room

X, Y, Z = 4.0, 2.6, 3.4
SEAM = 1.37  # where one floor slab ends and the next begins


def scene() -> Scene:
    materials = [
        Material("plaster", (0.72, 0.70, 0.66)),
        Material("warm", (0.58, 0.38, 0.26)),
        Material("stone", (0.48, 0.46, 0.43)),
        Material("wood", (0.40, 0.25, 0.14)),
        Material("cloth", (0.14, 0.24, 0.36)),
        Material("books", (0.46, 0.13, 0.10)),
        Material("housing", (0.3, 0.3, 0.3)),
        Material("lamp", (0.0, 0.0, 0.0), emission=(1500.0, 1370.0, 1130.0)),
    ]
    sides = {"ceiling": "plaster", "left": "warm", "right": "plaster", "back": "plaster", "front": "plaster"}
    meshes = room.walls((X, Y, Z), sides)
    meshes += [
        Builder("floor_left", "stone").face((0, 0, 0), (0, 0, Z), (SEAM, 0, Z), (SEAM, 0, 0)).mesh(),
        Builder("floor_right", "stone").face((SEAM, 0, 0), (SEAM, 0, Z), (X, 0, Z), (X, 0, 0)).mesh(),
        table().mesh(),
        stool().mesh(),
        Builder("shelf", "wood").box((0.9, 1.45, 0), (2.3, 1.49, 0.26), without="-z").mesh(),
        books().mesh(),
        Builder("box", "cloth").block((3.35, 0, 0.62), (0.5, 0.42, 0.5), turn=24, without="-y").mesh(),
    ]
    meshes += room.hanging_lamp("lamp", (1.45, 2.35, 1.05), (0.2, 0.05, 0.2), "housing", "lamp")
    camera = Camera.towards((3.55, 1.72, 3.32), (1.55, 0.72, 0.75), 52.0, 4 / 3)
    return Scene("table", "A table in a room. CC0.", materials, meshes, camera)


def table() -> Builder:
    t = Builder("table", "wood")
    x, z, wide, deep, leg = 0.95, 0.72, 1.5, 0.8, 0.05
    t.box((x, 0.71, z), (x + wide, 0.75, z + deep))
    for i in (x + 0.06, x + wide - 0.06 - leg):
        for k in (z + 0.06, z + deep - 0.06 - leg):
            t.box((i, 0, k), (i + leg, 0.71, k + leg), without="-y +y")
    return t


def stool() -> Builder:
    s = Builder("stool", "cloth")
    s.block((2.75, 0.42, 1.28), (0.36, 0.04, 0.36), turn=12)
    for i, k in ((-0.13, -0.13), (-0.13, 0.13), (0.13, -0.13), (0.13, 0.13)):
        s.block((2.75 + i, 0, 1.28 + k), (0.035, 0.42, 0.035), turn=12, without="-y +y")
    return s


def books() -> Builder:
    b = Builder("books", "books")
    b.block((1.35, 0.75, 1.05), (0.24, 0.05, 0.17), turn=15, without="-y")
    b.block((1.36, 0.80, 1.05), (0.21, 0.04, 0.15), turn=-8, without="-y")
    for k in range(6):
        b.box((1.05 + 0.055 * k, 1.49, 0.03), (1.095 + 0.055 * k, 1.70 + 0.02 * (k * 7 % 4), 0.2), without="-y")
    return b
