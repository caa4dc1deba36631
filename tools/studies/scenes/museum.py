"""A museum hall lit from above its baffles: troughs hang across the hall, lamps shine out of them at the vault, and nothing
below sees a lamp. All light on walls and exhibits has been reflected at least once.

9.0 x 5.4 x 16.0 m.
"""

from math import cos, pi, sin

from sample_scenes.model import Builder, Camera, Material, Mesh, Scene

from . import room

X, Y, Z = 9.0, 5.4, 16.0
TROUGH_Y = 4.25
TROUGHS = [1.6 + 2.56 * k for k in range(6)]


def scene() -> Scene:
    materials = [
        Material("wall", (0.72, 0.70, 0.66)),
        Material("vault", (0.82, 0.82, 0.80)),
        Material("oak", (0.36, 0.24, 0.14)),
        Material("baffle", (0.62, 0.60, 0.56)),
        Material("plinth", (0.66, 0.65, 0.62)),
        Material("bronze", (0.24, 0.15, 0.08)),
        Material("marble", (0.74, 0.72, 0.69)),
        Material("clay", (0.52, 0.20, 0.10)),
        Material("glaze", (0.08, 0.26, 0.34)),
        Material("frame", (0.10, 0.07, 0.04)),
        Material("canvas", (0.70, 0.66, 0.55)),
        Material("red", (0.58, 0.07, 0.05)),
        Material("blue", (0.07, 0.13, 0.42)),
        Material("yellow", (0.70, 0.50, 0.07)),
        Material("leather", (0.16, 0.09, 0.06)),
        Material("lamp", (0.0, 0.0, 0.0), emission=(9000.0, 8500.0, 7600.0)),
    ]
    sides = {"floor": "oak", "left": "wall", "right": "wall", "back": "wall", "front": "wall", "ceiling": "vault"}
    meshes = room.walls((X, Y, Z), sides)
    for k, z in enumerate(TROUGHS):
        meshes += trough(f"trough_{k}", z)
    meshes.append(Builder("partition", "wall").box((2.4, 0, 3.9), (6.6, 3.1, 4.2), without="-y").mesh())
    meshes += exhibits()
    meshes += picture("picture_partition", "z", 4.2, (3.5, 5.5), (0.9, 2.5), 0)
    for k, (a, b) in enumerate([(5.2, 6.8), (7.9, 9.9), (11.2, 12.6)]):
        meshes += picture(f"picture_left_{k}", "x", 0.0, (a, b), (1.0, 2.4), 1 + k)
        meshes += picture(f"picture_right_{k}", "-x", X, (a, b), (1.0, 2.4), 4 + k)
    camera = Camera.towards((5.5, 1.75, 15.4), (4.35, 2.0, 4.0), 60.0, 4 / 3)
    return Scene("museum", "A museum hall, lit over baffles. CC0.", materials, meshes, camera)


def trough(name: str, z: float) -> list[Mesh]:
    """A channel along X with sloping sides, hung 0.15 m clear of the walls; in it a lamp that shines upwards."""
    a, b, y = 0.15, X - 0.15, TROUGH_Y
    outer = [(z - 0.62, y + 0.34), (z - 0.34, y), (z + 0.34, y), (z + 0.62, y + 0.34)]
    inner = [(z - 0.57, y + 0.34), (z - 0.31, y + 0.04), (z + 0.31, y + 0.04), (z + 0.57, y + 0.34)]
    outer, inner = ([(round(p, 6), round(q, 6)) for p, q in line] for line in (outer, inner))
    t = Builder(name, "baffle")

    def strip(p, q):
        """From line p to line q along X; the front looks down where q lies further along +Z."""
        t.face((a, p[1], p[0]), (b, p[1], p[0]), (b, q[1], q[0]), (a, q[1], q[0]))

    for p, q in zip(outer, outer[1:]):
        strip(p, q)
    for p, q in zip(inner, inner[1:]):
        strip(q, p)
    strip(inner[0], outer[0])
    strip(outer[3], inner[3])
    for k in range(3):
        corners = [outer[k], outer[k + 1], inner[k + 1], inner[k]]
        t.face(*((b, v, u) for u, v in corners[::-1]))
        t.face(*((a, v, u) for u, v in corners))
    low, high = (0.6, y + 0.04, round(z - 0.07, 6)), (X - 0.6, y + 0.09, round(z + 0.07, 6))
    return [
        t.mesh(),
        Builder(f"{name}_socket", "baffle").box(low, high, without="-y +y").mesh(),
        Builder(f"{name}_lamp", "lamp").box(low, high, without="-x +x -y -z +z").mesh(),
    ]


def exhibits() -> list[Mesh]:
    out = []

    def plinth(name: str, x: float, z: float, height: float, size: float = 0.7) -> tuple[float, float, float]:
        out.append(Builder(f"{name}_plinth", "plinth").block((x, 0, z), (size, height, size), without="-y").mesh())
        return (x, height, z)

    def solid(name: str, material: str, centre, profile, sides: int = 16) -> None:
        out.append(Builder(name, material).lathe(centre, [(r, round(h, 6)) for r, h in profile], sides).mesh())

    x, y, z = plinth("globe", 2.3, 7.2, 0.9)
    ball = [(0.34 * sin(pi * k / 10) if 0 < k < 10 else 0.0, 0.02 + 0.34 * (1 - cos(pi * k / 10))) for k in range(11)]
    solid("globe", "bronze", (x, y, z), ball, 18)
    vase = [(0.0, 0.0), (0.12, 0.0), (0.24, 0.18), (0.27, 0.34), (0.2, 0.52), (0.09, 0.66), (0.08, 0.74), (0.14, 0.8), (0.11, 0.8), (0.06, 0.74), (0.0, 0.7)]
    solid("vase", "glaze", plinth("vase", 6.75, 8.6, 1.0, 0.6), vase, 18)
    solid("amphora", "clay", plinth("amphora", 2.1, 11.4, 0.8, 0.6), [(r * 1.1, h * 1.2) for r, h in vase], 18)
    column = [(0.0, 0.0), (0.42, 0.0), (0.42, 0.14), (0.3, 0.2), (0.27, 2.3), (0.36, 2.42), (0.36, 2.56), (0.0, 2.56)]
    solid("column_left", "marble", (1.2, 0, 2.4), column, 20)
    solid("column_right", "marble", (7.8, 0, 2.4), column, 20)
    x, y, z = plinth("stack", 6.9, 5.9, 0.5, 0.9)
    stack = Builder("stack", "marble")
    for k, (w, h, turn) in enumerate([(0.6, 0.4, 0), (0.46, 0.42, 24), (0.32, 0.5, 48), (0.2, 0.46, 72)]):
        stack.block((x, round(y + [0, 0.4, 0.82, 1.32][k], 6), z), (w, h, w), turn, without="-y")
    out.append(stack.mesh())
    bench = Builder("bench", "leather").box((3.6, 0.38, 8.5), (5.2, 0.48, 9.1))
    legs = Builder("bench_legs", "frame")
    for i in (3.7, 5.0):
        legs.box((i, 0, 8.56), (i + 0.1, 0.38, 9.04), without="-y +y")
    return [*out, bench.mesh(), legs.mesh()]


def picture(name: str, facing: str, wall: float, across: tuple[float, float], height: tuple[float, float], pattern: int) -> list[Mesh]:
    """A frame on a wall, 6 cm deep, and in it a canvas of coloured fields, arranged by the number of its `pattern`."""
    (a, b), (c, d) = across, height
    frame, deep = 0.07, 0.06

    def place(u: float, v: float, w: float):
        """Along the wall, up, away from the wall."""
        p = {"z": (u, v, wall + w), "x": (wall + w, v, a + b - u), "-x": (wall - w, v, u)}[facing]
        return tuple(round(q, 6) for q in p)

    def face(builder: Builder, low, high, w: float) -> None:
        builder.face(*(place(u, v, w) for u, v in ((low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1]))))

    border = Builder(f"{name}_frame", "frame")
    us, vs = (a, a + frame, b - frame, b), (c, c + frame, d - frame, d)
    corners = [(us[0], vs[0]), (us[3], vs[0]), (us[3], vs[3]), (us[0], vs[3])]
    inside = [(us[1], vs[1]), (us[2], vs[1]), (us[2], vs[2]), (us[1], vs[2])]
    for k in range(4):
        p, q, r, s = corners[k], corners[(k + 1) % 4], inside[(k + 1) % 4], inside[k]
        border.face(place(*p, deep), place(*q, deep), place(*r, deep), place(*s, deep))
        border.face(place(*p, 0), place(*q, 0), place(*q, deep), place(*p, deep))
        border.face(place(*s, deep), place(*r, deep), place(*r, deep / 2), place(*s, deep / 2))
    # Fields between lines at these shares of the canvas; every cell is a face, so that corners meet.
    xs = [us[1] + (us[2] - us[1]) * t for t in (0, 0.22 + 0.05 * (pattern % 3), 0.7 - 0.06 * (pattern % 4), 1)]
    ys = [vs[1] + (vs[2] - vs[1]) * t for t in (0, 0.3 + 0.07 * (pattern % 2), 0.78 - 0.07 * (pattern % 5), 1)]
    names = ("canvas", "red", "canvas", "blue", "canvas", "yellow", "red")
    fields = {m: Builder(f"{name}_{m}", m) for m in names}
    for i in range(3):
        for k in range(3):
            face(fields[names[(3 * i + k * (pattern + 2) + pattern) % 7]], (xs[i], ys[k]), (xs[i + 1], ys[k + 1]), deep / 2)
    return [border.mesh(), *(f.mesh() for f in fields.values() if f.faces)]
