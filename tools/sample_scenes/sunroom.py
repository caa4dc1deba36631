"""A room with a plank floor, a window, sun and sky, as USD with UsdLux; metres, Z up.

The walls are single-sided and face inwards; the window's reveal is as deep as the wall is thick. Edges that meet lie on the same
axis-aligned lines, so nothing leaks, and from outside one looks in.
"""

from math import atan2, cos, degrees, radians, sin

from . import png, usda
from .model import Builder, Material, Mesh

X, Y, Z = 5.0, 4.0, 2.8  # the room, window wall at y = 0
WALL = 0.3
WINDOW_X, WINDOW_Z = (1.1, 3.9), (0.8, 2.3)
SUN_ELEVATION, SUN_AZIMUTH = 38.0, 22.0  # [degrees]; azimuth from straight in front of the window towards +X
SUN_LUX, SKY_NIT = 60000.0, 4000.0
PLANK_TILE = 1.28  # metres across the floor's texture
MATERIALS = "/sunroom/materials"


def room() -> list[Mesh]:
    floor = Builder("floor", "planks").face((0, 0, 0), (X, 0, 0), (X, Y, 0), (0, Y, 0)).mesh()
    floor.uvs = [(p[0] / PLANK_TILE, p[1] / PLANK_TILE) for p in floor.points]
    walls = Builder("walls", "plaster")
    walls.face((0, Y, 0), (X, Y, 0), (X, Y, Z), (0, Y, Z))
    xs, zs = (0.0, *WINDOW_X, X), (0.0, *WINDOW_Z, Z)
    for i in range(3):
        for k in range(3):
            if (i, k) != (1, 1):
                a, b, c, d = xs[i], xs[i + 1], zs[k], zs[k + 1]
                walls.face((a, 0, c), (a, 0, d), (b, 0, d), (b, 0, c))
    (a, b), (c, d) = WINDOW_X, WINDOW_Z
    walls.face((a, -WALL, c), (b, -WALL, c), (b, 0, c), (a, 0, c))
    walls.face((a, -WALL, d), (a, 0, d), (b, 0, d), (b, -WALL, d))
    walls.face((a, -WALL, c), (a, 0, c), (a, 0, d), (a, -WALL, d))
    walls.face((b, -WALL, c), (b, -WALL, d), (b, 0, d), (b, 0, c))
    left = Builder("left_wall", "terracotta").face((0, 0, 0), (0, Y, 0), (0, Y, Z), (0, 0, Z))
    right = Builder("right_wall", "plaster").face((X, 0, 0), (X, 0, Z), (X, Y, Z), (X, Y, 0))
    ceiling = Builder("ceiling", "plaster").face((0, 0, Z), (0, Y, Z), (X, Y, Z), (X, 0, Z))
    bars = Builder("window_bars", "wood")
    middle, half = (a + b) / 2, 0.03
    bars.box((middle - half, -0.18, c), (middle + half, -0.12, d), without="-z +z")
    return [floor, walls.mesh(), left.mesh(), right.mesh(), ceiling.mesh(), bars.mesh()]


def table() -> Mesh:
    t = Builder("table", "wood")
    x, y = 2.0, 2.0
    t.box((x, y, 0.70), (x + 1.4, y + 0.8, 0.74))
    for i in (0.05, 1.29):
        for k in (0.05, 0.69):
            t.box((x + i, y + k, 0), (x + i + 0.06, y + k + 0.06, 0.70), without="-z +z")
    return t.mesh()


def crate() -> Mesh:
    return Builder("crate", "blue").box((0.4, 3.0, 0), (1.0, 3.6, 0.6), without="-z").mesh()


def chair() -> list[Mesh]:
    """Around its own origin on the floor, its back towards +Y."""
    seat = Builder("seat", "blue").box((-0.21, -0.21, 0.42), (0.21, 0.21, 0.46))
    seat.box((-0.21, 0.17, 0.46), (0.21, 0.21, 0.90), without="-z")
    legs = Builder("legs", "wood")
    for i in (-0.20, 0.16):
        for k in (-0.20, 0.16):
            legs.box((i, k, 0), (i + 0.04, k + 0.04, 0.42), without="-z +z")
    return [seat.mesh(), legs.mesh()]


def instance(name: str, x: float, y: float, turn: float) -> str:
    body = (
        f"double xformOp:rotateZ = {usda.number(turn)}\ndouble3 xformOp:translate = {usda.tuple_of((x, y, 0))}\n"
        'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateZ"]\n'
    )
    return f'def Xform "{name}" (\n    instanceable = true\n    prepend references = </_chair>\n)\n{{\n{usda.indent(body)}}}\n\n'


def lights() -> str:
    # A DistantLight shines along its -Z: tipped up from straight down, then turned about the vertical.
    sun = (
        "float inputs:angle = 0.53\ncolor3f inputs:color = (1, 0.93, 0.82)\n"
        f"float inputs:intensity = {usda.number(SUN_LUX)}\nbool inputs:normalize = 1\n"
        f"double3 xformOp:rotateXYZ = {usda.tuple_of((90 - SUN_ELEVATION, 0, SUN_AZIMUTH))}\n"
        'uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]\n'
    )
    sky = f"color3f inputs:color = (0.6, 0.78, 1)\nfloat inputs:intensity = {usda.number(SKY_NIT)}\n"
    return f'def DistantLight "sun"\n{{\n{usda.indent(sun)}}}\n\ndef DomeLight "sky"\n{{\n{usda.indent(sky)}}}\n\n'


def camera() -> str:
    eye, target = (4.75, 3.75, 1.75), (1.9, 1.3, 0.9)
    away = [a - b for a, b in zip(eye, target)]
    flat = (away[0] ** 2 + away[1] ** 2) ** 0.5
    tip, turn = 90 - degrees(atan2(away[2], flat)), degrees(atan2(away[0], -away[1]))
    body = (
        "float2 clippingRange = (0.01, 1000)\nfloat focalLength = 18\nfloat horizontalAperture = 32\nfloat verticalAperture = 24\n"
        f"double3 xformOp:rotateXYZ = {usda.tuple_of((round(tip, 3), 0, round(turn, 3)))}\n"
        f"double3 xformOp:translate = {usda.tuple_of(eye)}\n"
        'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]\n'
    )
    return f'def Camera "camera"\n{{\n{usda.indent(body)}}}\n\n'


def planks(size: int = 128) -> bytes:
    """Four rows of planks with staggered ends and a little grain; tiles."""
    palette = [(150 - 7 * i, 108 - 6 * i, 70 - 5 * i) for i in range(10)] + [(52, 36, 24)]
    wide, long = size // 4, size // 2
    rows = []
    for y in range(size):
        row = bytearray()
        for x in range(size):
            lane = y // wide
            along = (x + lane * long * 5 // 8) % size
            if y % wide == 0 or along % long == 0:
                row.append(10)
                continue
            tone = (lane * 7 + along // long * 5) % 4 * 2
            grain = (y * 37 + lane * 11 + (along // 16) * (y % 3)) % 7
            row.append(min(tone + (grain > 4) + (grain == 0), 9))
        rows.append(bytes(row))
    return png.paletted(size, rows, palette)


def write() -> str:
    materials = [
        Material("plaster", (0.78, 0.77, 0.74)),
        Material("terracotta", (0.58, 0.24, 0.15)),
        Material("blue", (0.12, 0.26, 0.5)),
        Material("wood", (0.42, 0.27, 0.15)),
        Material("planks", (0.3, 0.2, 0.1), texture="planks.png"),
    ]
    body = "".join(usda.mesh(m, MATERIALS) for m in [*room(), table(), crate()])
    body += instance("chair_1", 2.35, 1.75, 180) + instance("chair_2", 3.05, 3.1, 8) + instance("chair_3", 4.3, 1.1, -62)
    body += lights() + camera() + usda.scope("materials", "".join(usda.material(m, MATERIALS) for m in materials))
    # The chair carries its materials with it: what an instance shares must not point out of its prototype.
    own = [m for m in materials if m.name in ("blue", "wood")]
    shared = "".join(usda.mesh(m, "/_chair/materials") for m in chair())
    shared += usda.scope("materials", "".join(usda.material(m, "/_chair/materials") for m in own))
    prototype = f'\nclass Xform "_chair"\n{{\n{usda.indent(shared.rstrip() + chr(10))}}}\n'
    return usda.layer("A room with a window, sun and sky, metres, Z up. CC0.", "sunroom", body, up_axis="Z", extra=prototype)


def sun_direction() -> tuple[float, float, float]:
    """The way the sun's light travels, Z up."""
    e, a = radians(SUN_ELEVATION), radians(SUN_AZIMUTH)
    return (-sin(a) * cos(e), cos(a) * cos(e), -sin(e))
