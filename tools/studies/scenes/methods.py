"""Rooms in which methods differ: light through glass, through a door ajar, over a bowl, in fog. 2.4 m high."""

from sample_scenes.model import Builder, Camera, Material, Scene

from . import room

HEIGHT = 2.4
GLASS = {
    "pbrMetallicRoughness": {"roughnessFactor": 0.0},
    "extensions": {
        "KHR_materials_transmission": {"transmissionFactor": 1.0},
        "KHR_materials_volume": {"thicknessFactor": 1.0},
    },
}


def walls(low: tuple, high: tuple, material: str = "plaster", without: str = "") -> list:
    """The inner faces of a box, all of one material."""
    sides = ("floor", "ceiling", "left", "right", "back", "front")
    return room.walls(high, {side: material for side in sides if side != without}, low)


def panel(name: str, low: tuple, high: tuple, y: float) -> object:
    """A lamp that shines down from the height `y`."""
    (a, c), (d, f) = low, high
    return Builder(name, "lamp").face((a, y, c), (d, y, c), (d, y, f), (a, y, f)).mesh()


def materials(lamp: float) -> list[Material]:
    return [
        Material("plaster", (0.72, 0.70, 0.66)),
        Material("wood", (0.40, 0.25, 0.14)),
        Material("lamp", (0.0, 0.0, 0.0), emission=(lamp, 0.92 * lamp, 0.78 * lamp)),
        Material("glass", (1.0, 1.0, 1.0), looks=GLASS),
    ]


def caustic() -> Scene:
    """A ball of glass on the floor below a small lamp."""
    centre = (1.0, 0.35, 0.9)
    meshes = walls((0, 0, 0), (2.0, HEIGHT, 2.0))
    meshes += [panel("lamp", (0.68, 0.86), (0.74, 0.92), HEIGHT - 0.02), Builder("ball", "glass").ball(centre, 0.3, 32).mesh(centre)]
    camera = Camera.towards((1.2, 1.5, 1.95), (1.05, 0.2, 0.75), 50.0, 4 / 3)
    return Scene("caustic", "A ball of glass below a lamp. CC0.", materials(20000.0), meshes, camera)


def door_ajar() -> Scene:
    """Two rooms, and a door between them that is open by a hand's breadth; the lamp is in the other room."""
    wall, thick = 2.0, 0.1
    meshes = walls((0, 0, 0), (2.4, HEIGHT, wall), without="front")
    other = walls((0, 0, wall + thick), (2.4, HEIGHT, 4.1), without="back")
    for mesh in other:
        mesh.name = f"other_{mesh.name}"
    meshes += other
    # The wall between them, with a doorway from 0.8 to 1.6.
    between = Builder("wall", "plaster")
    for low, high in [((0, 0), (0.8, HEIGHT)), ((1.6, 0), (2.4, HEIGHT)), ((0.8, 2.0), (1.6, HEIGHT))]:
        between.box((low[0], low[1], wall), (high[0], high[1], wall + thick))
    door = Builder("door", "wood").block((0.8 + 0.392, 0.005, wall + 0.12), (0.8, 1.99, 0.04), turn=-9.0)
    meshes += [between.mesh(), door.mesh(), panel("lamp", (0.4, 3.2), (0.8, 3.6), HEIGHT - 0.02)]
    camera = Camera.towards((0.35, 1.5, 0.2), (1.5, 0.95, 2.0), 62.0, 4 / 3)
    return Scene("door_ajar", "Two rooms and a door ajar. CC0.", materials(3000.0), meshes, camera)


def bowl() -> Scene:
    """A lamp in a bowl that hides it: all light comes over the ceiling."""
    meshes = walls((0, 0, 0), (2.4, HEIGHT, 2.4))
    outside = Builder("bowl", "plaster").lathe((1.2, 1.5, 0.9), [(0.0, 0.0), (0.16, 0.03), (0.24, 0.12), (0.26, 0.24)], 32)
    inside = Builder("inside", "plaster").lathe((1.2, 1.51, 0.9), [(0.0, 0.0), (0.155, 0.03), (0.235, 0.12), (0.255, 0.23)], 32)
    inside.faces = [face[::-1] for face in inside.faces]
    lamp = Builder("lamp", "lamp").box((1.17, 1.56, 0.87), (1.23, 1.62, 0.93))
    table = Builder("table", "wood").box((0.7, 0.7, 0.5), (1.7, 0.74, 1.3))
    camera = Camera.towards((2.2, 1.6, 2.3), (1.1, 1.0, 0.6), 60.0, 4 / 3)
    return Scene("bowl", "A lamp in a bowl. CC0.", materials(15000.0), meshes + [m.mesh() for m in (outside, inside, lamp, table)], camera)


def fog() -> Scene:
    """A dark room in fog, lit by a lamp behind a wall with slots."""
    meshes = walls((0, 0, 0), (2.4, HEIGHT, 2.4), "wood")
    slots = Builder("slots", "wood")
    for k in range(6):
        slots.box((0.3 + 0.3 * k, 1.7, 0.2), (0.52 + 0.3 * k, 1.74, 1.6))
    meshes += [slots.mesh(), panel("lamp", (1.05, 0.8), (1.35, 1.1), HEIGHT - 0.02)]
    camera = Camera.towards((1.2, 1.1, 2.35), (1.2, 1.0, 0.8), 62.0, 4 / 3)
    medium = {"scattering": 0.5, "absorption": 0.05, "g": 0.4}
    middle, size = (1.2, HEIGHT / 2, 1.2), (2.4, HEIGHT, 2.4)
    return Scene("fog", "Light through slots in fog. CC0.", materials(8000.0), meshes, camera, media=[("fog", middle, size, medium)])


SCENES = {"caustic": caustic, "door_ajar": door_ajar, "bowl": bowl, "fog": fog}
