"""Rooms in which lightmaps leak or show dark and bright rims unless the baker heeds corners: thin walls, contacts, gaps.

Every room is a shell that faces inwards, and all that stands in it is made of solid boxes, so that what lies inside of something is
known without the baker.
"""

from dataclasses import dataclass
from math import cos, radians, sin

from .model import Builder, Camera, Material, Mesh, Scene, Vec3

DENSITY = 10  # texels per metre at which answers are stated


@dataclass
class Solid:
    """A box of half extents `half` around `centre`, its axes turned by `turn` about Y after `tip` about Z [degrees]."""

    name: str
    material: str
    centre: Vec3
    half: Vec3
    turn: float = 0.0
    tip: float = 0.0
    without: str = ""

    @staticmethod
    def between(name: str, material: str, low: Vec3, high: Vec3, without: str = "") -> "Solid":
        centre = tuple(round((a + b) / 2, 6) for a, b in zip(low, high))
        return Solid(name, material, centre, tuple(round((b - a) / 2, 6) for a, b in zip(low, high)), without=without)

    def axes(self) -> list[Vec3]:
        """The world directions of the box's own axes."""
        c, s = cos(radians(self.turn)), sin(radians(self.turn))
        a, b = cos(radians(self.tip)), sin(radians(self.tip))
        return [(c * a, b, -s * a), (-c * b, a, s * b), (s, 0.0, c)]

    def mesh(self) -> Mesh:
        axes = self.axes()

        def place(p: Vec3) -> Vec3:
            return tuple(round(self.centre[k] + sum(p[i] * axes[i][k] for i in range(3)), 6) for k in range(3))

        h = self.half
        part = Builder("", "").box(tuple(-v for v in h), h, self.without)
        return Builder(self.name, self.material).add(part, place).mesh()


@dataclass
class Case:
    """A scene, and all that is solid in it and around its room."""

    scene: Scene
    solids: list[Solid]


MATERIALS = [
    Material("plaster", (0.7, 0.7, 0.7)),
    Material("wood", (0.5, 0.35, 0.2)),
    Material("cloth", (0.3, 0.2, 0.45)),
]


def shell(x: float, y: float, z: float) -> list[Mesh]:
    """The inner faces of a room from the origin to x, y, z: a surface each."""
    faces = {
        "floor": [(0, 0, 0), (0, 0, z), (x, 0, z), (x, 0, 0)],
        "ceiling": [(0, y, 0), (x, y, 0), (x, y, z), (0, y, z)],
        "left": [(0, 0, 0), (0, y, 0), (0, y, z), (0, 0, z)],
        "right": [(x, 0, 0), (x, 0, z), (x, y, z), (x, y, 0)],
        "back": [(0, 0, 0), (x, 0, 0), (x, y, 0), (0, y, 0)],
        "front": [(0, 0, z), (0, y, z), (x, y, z), (x, 0, z)],
    }
    return [Builder(name, "plaster").face(*corners).mesh() for name, corners in faces.items()]


def around(x: float, y: float, z: float, depth: float = 1.0) -> list[Solid]:
    """What lies outside of a shell's faces."""
    size, sides = (x, y, z), []
    for k in range(3):
        for low, high in ((-depth, 0.0), (size[k], size[k] + depth)):
            a, b = [-depth] * 3, [v + depth for v in size]
            a[k], b[k] = low, high
            sides.append(Solid.between("outside", "plaster", tuple(a), tuple(b)))
    return sides


def lamp(name: str, centre: Vec3, half: float) -> Mesh:
    """A square that shines down."""
    x, y, z = centre
    a, b, c, d = round(x - half, 6), round(x + half, 6), round(z - half, 6), round(z + half, 6)
    return Builder(name, "lamp").face((a, y, c), (b, y, c), (b, y, d), (a, y, d)).mesh()


def case(name: str, comment: str, room: Vec3, others: list[Mesh], solids: list[Solid], camera: Camera) -> Case:
    materials = [*MATERIALS, Material("lamp", (0.0, 0.0, 0.0), emission=(20.0, 20.0, 20.0))]
    meshes = [*shell(*room), *(s.mesh() for s in solids), *others]
    return Case(Scene(name, f"{comment} Metres, Y up. CC0.", materials, meshes, camera), [*solids, *around(*room)])


def thin_wall() -> Case:
    """Rooms side by side under one ceiling and on one floor: lit, dark, lit."""
    wall = Solid.between("wall", "plaster", (1.83, 0, 0), (1.85, 2, 2), without="-y +y -z +z")
    sheet = Builder("sheet", "plaster").face((3.47, 0, 0), (3.47, 0, 2), (3.47, 2, 2), (3.47, 2, 0)).mesh()
    sheet.double_sided = True
    others = [sheet, lamp("lamp_1", (0.9, 1.9, 1.0), 0.3), lamp("lamp_2", (4.4, 1.9, 1.0), 0.3)]
    camera = Camera.towards((2.66, 1.3, 1.9), (2.66, 0.4, 0.0), 60.0, 1.5)
    comment = "A dark room between two lit ones, behind a wall 2 cm thick and behind one that is a single double-sided face."
    return case("thin_wall", comment, (5.3, 2.0, 2.0), others, [wall], camera)


def door_ajar() -> Case:
    """A lit room and a dark one, and a door between them that is 12 degrees open."""
    x, t = 2.0, 0.12
    low, high, top = 0.55, 1.35, 1.7
    wall = [
        Solid.between("wall_1", "plaster", (x, 0, 0), (x + t, 2.2, low)),
        Solid.between("wall_2", "plaster", (x, 0, high), (x + t, 2.2, 2.0)),
        Solid.between("lintel", "plaster", (x, top, low), (x + t, 2.2, high)),
    ]
    # Hinged at z = low on the dark side, 6 mm above the floor and 2 mm below the lintel.
    turn, thick, width = 12.0, 0.04, high - low
    c, s = cos(radians(turn)), sin(radians(turn))
    centre = (x + t + thick / 2 * c + width / 2 * s, (0.006 + top - 0.002) / 2, low - thick / 2 * s + width / 2 * c)
    half = (thick / 2, (top - 0.008) / 2, width / 2)
    leaf = Solid("door", "wood", tuple(round(v, 6) for v in centre), tuple(round(v, 6) for v in half), turn=turn)
    lamps = [lamp("lamp", (0.9, 2.1, 1.0), 0.3)]
    camera = Camera.towards((4.0, 1.4, 1.8), (2.2, 0.7, 0.8), 60.0, 1.5)
    comment = "A lit room, a dark one, and a door that is ajar."
    return case("door_ajar", comment, (4.2, 2.2, 2.0), lamps, [*wall, leaf], camera)


def box_on_floor() -> Case:
    """Contacts: boxes that stand on a floor, are sunk into it and float 1 mm above; a carpet, a rug's face alone, a picture."""
    solids = [
        Solid.between("standing", "wood", (0.43, 0, 0.37), (0.91, 0.4, 0.83)),
        Solid("sunken", "wood", (1.58, 0.19, 0.61), (0.23, 0.21, 0.23), turn=25.0),
        Solid.between("floating", "wood", (2.17, 0.001, 0.44), (2.66, 0.4, 0.87)),
        Solid.between("without_bottom", "wood", (0.36, 0, 1.44), (0.79, 0.4, 1.87), without="-y"),
        Solid.between("carpet", "cloth", (1.13, 0.005, 1.26), (1.97, 0.013, 1.94)),
        Solid.between("rug", "cloth", (2.18, 0.005, 1.27), (2.74, 0.005, 1.93), without="-x +x -y -z +z"),
        Solid.between("picture", "wood", (0.95, 0.82, 0.002), (1.75, 1.38, 0.022)),
    ]
    lamps = [lamp("lamp", (1.5, 1.9, 1.2), 0.4)]
    camera = Camera.towards((2.9, 1.6, 2.2), (1.3, 0.2, 0.8), 60.0, 1.5)
    comment = "Things that touch a floor and a wall, or nearly so."
    return case("box_on_floor", comment, (3.0, 2.0, 2.3), lamps, solids, camera)


def props() -> Case:
    """Boxes through boxes, through the floor and through a wall."""
    solids = [
        Solid("crate_1", "wood", (0.75, 0.3, 0.8), (0.3, 0.3, 0.3), turn=10.0),
        Solid("crate_2", "wood", (1.05, 0.25, 1.05), (0.3, 0.25, 0.25), turn=-35.0),
        Solid("beam_1", "plaster", (1.9, 0.9, 0.9), (1.3, 0.06, 0.06), turn=20.0, tip=20.0),
        Solid("beam_2", "plaster", (2.0, 0.8, 0.9), (0.06, 1.0, 0.06), tip=8.0),
        Solid("slab", "wood", (2.2, 0.1, 1.6), (0.5, 0.05, 0.3), turn=-15.0, tip=12.0),
        Solid("shelf", "wood", (1.3, 1.2, 0.05), (0.5, 0.02, 0.2)),
    ]
    lamps = [lamp("lamp", (0.9, 1.9, 1.4), 0.3)]
    camera = Camera.towards((2.8, 1.7, 2.2), (1.4, 0.4, 0.8), 60.0, 1.5)
    comment = "Props that go through each other, a floor and a wall."
    return case("props", comment, (3.0, 2.0, 2.3), lamps, solids, camera)


def cases() -> list[Case]:
    return [thin_wall(), door_ajar(), box_on_floor(), props()]
