"""A factory hall: machines along a conveyor, roof trusses, a travelling crane, lamps under the roof.

16 x 36 m, 6.2 m high at the eaves and 8.6 m at the ridge; the lamps shine downwards alone, so that the roof and much of what
stands between the machines has reflected light only. (Cohen, Chen, Wallace, Greenberg 1988 showed progressive refinement on a
factory of 30,000 patches.)
"""

from math import cos, pi, sin

from sample_scenes.model import Builder, Camera, Material, Mesh, Scene, Vec3

X, EAVES, RIDGE, Z = 16.0, 6.2, 8.6, 36.0
BAYS = [3.0 + 5.0 * k for k in range(7)]
BELT_X, BELT_Z = 8.0, (3.0, 31.5)


def scene() -> Scene:
    materials = [
        Material("concrete", (0.34, 0.33, 0.31)),
        Material("lane", (0.62, 0.46, 0.07)),
        Material("dado", (0.22, 0.34, 0.29)),
        Material("plaster", (0.66, 0.63, 0.56)),
        Material("roof", (0.58, 0.59, 0.58)),
        Material("steel", (0.32, 0.35, 0.38)),
        Material("oxide", (0.40, 0.13, 0.08)),
        Material("green", (0.13, 0.32, 0.22)),
        Material("orange", (0.60, 0.24, 0.05)),
        Material("yellow", (0.66, 0.46, 0.06)),
        Material("blue", (0.09, 0.18, 0.42)),
        Material("rubber", (0.06, 0.06, 0.06)),
        Material("card", (0.48, 0.34, 0.20)),
        Material("shade", (0.45, 0.47, 0.46)),
        Material("lamp", (0.0, 0.0, 0.0), emission=(2600.0, 2450.0, 2100.0)),
    ]
    meshes = hall() + steelwork() + crane() + conveyor()
    for k, z in enumerate(BAYS[:-1]):
        meshes += press(f"press_{k}", 3.4, z + 1.2, ("green", "blue", "green")[k % 3])
        meshes += tank(f"tank_{k}", 12.9, z + 2.2, ("steel", "orange")[k % 2]) if k % 3 == 1 else lathe_bench(f"lathe_{k}", 12.6, z + 1.6)
        meshes += pallet(f"pallet_{k}", (5.5, 10.6)[k % 2], z + 3.6, k)
    for k, z in enumerate(BAYS):
        for x in (4.2, 11.8):
            meshes += pendant(f"lamp_{k}_{'left' if x < 8 else 'right'}", (x, 5.35, z + (1.0 if k < 6 else -0.9)))
    camera = Camera.towards((9.6, 4.3, 35.4), (7.6, 1.9, 18.0), 56.0, 4 / 3)
    return Scene("factory", "A factory hall. CC0.", materials, meshes, camera)


def hall() -> list[Mesh]:
    dado = 1.5
    floor, lane = Builder("floor", "concrete"), Builder("lanes", "lane")
    xs = [0.0, 5.9, 6.02, 9.98, 10.1, X]
    for k, (a, b) in enumerate(zip(xs, xs[1:])):
        (lane if k in (1, 3) else floor).face((a, 0, 0), (a, 0, Z), (b, 0, Z), (b, 0, 0))
    low, high = Builder("dado", "dado"), Builder("walls", "plaster")
    for builder, y0, y1 in ((low, 0, dado), (high, dado, EAVES)):
        builder.face((0, y0, 0), (0, y1, 0), (0, y1, Z), (0, y0, Z))
        builder.face((X, y0, 0), (X, y0, Z), (X, y1, Z), (X, y1, 0))
    m = X / 2
    # The ends share the floor's corners, so that no edge ends in the middle of another.
    low.face((0, dado, 0), *((x, 0, 0) for x in xs), (X, dado, 0))
    low.face((X, dado, Z), *((x, 0, Z) for x in xs[::-1]), (0, dado, Z))
    high.face((0, dado, 0), (X, dado, 0), (X, EAVES, 0), (m, RIDGE, 0), (0, EAVES, 0))
    high.face((X, dado, Z), (0, dado, Z), (0, EAVES, Z), (m, RIDGE, Z), (X, EAVES, Z))
    roof = Builder("roof", "roof")
    roof.face((0, EAVES, 0), (m, RIDGE, 0), (m, RIDGE, Z), (0, EAVES, Z))
    roof.face((X, EAVES, 0), (X, EAVES, Z), (m, RIDGE, Z), (m, RIDGE, 0))
    return [b.mesh() for b in (floor, lane, low, high, roof)]


def steelwork() -> list[Mesh]:
    """A frame in every bay: columns against the walls, a truss across; two rails along the hall for the crane."""
    columns, trusses, rails = Builder("columns", "oxide"), Builder("trusses", "oxide"), Builder("rails", "steel")
    m = X / 2
    for z in BAYS:
        for a, b, side in ((0.0, 0.34, "-x"), (X - 0.34, X, "+x")):
            columns.box((a, 0, z - 0.17), (b, 5.85, z + 0.17), without=f"-y {side}")
        trusses.box((0.12, 5.86, z - 0.11), (X - 0.12, 6.08, z + 0.11))
        for x0, x1, s in ((0.3, m, 1), (X - 0.3, m, -1)):
            slope = (RIDGE - EAVES) / m
            trusses.bar((x0, EAVES + 0.3 * slope - 0.02, z), (x1 - 0.09 * s, RIDGE - 0.24, z), 0.16, 0.14)
            for k in (1, 2, 3):
                x = x0 + s * 1.92 * k
                top = EAVES + slope * (0.3 + 1.92 * k) - 0.26
                trusses.box((round(x - 0.05, 6), 6.07, z - 0.05), (round(x + 0.05, 6), round(top + 0.02, 6), z + 0.05), without="-y +y")
                trusses.bar((x + s * 0.06, 6.07, z), (x + s * 1.8, top + slope * 1.7, z), 0.08, 0.08)
    for a, b in ((0.5, 0.74), (X - 0.74, X - 0.5)):
        rails.box((a, 4.72, 0.15), (b, 5.02, Z - 0.15))
        low, high = (0.341, b - 0.02) if a < m else (a + 0.02, X - 0.341)
        for z in BAYS:
            rails.box((low, 4.4, z - 0.1), (high, 4.7, z + 0.1))
    return [columns.mesh(), trusses.mesh(), rails.mesh()]


def crane() -> list[Mesh]:
    bridge, hook = Builder("crane_bridge", "yellow"), Builder("crane_hook", "steel")
    for z in (13.2, 14.5):
        bridge.box((0.42, 5.04, z), (X - 0.42, 5.56, z + 0.3))
    bridge.box((8.9, 5.58, 13.15), (10.2, 5.84, 14.85))
    hook.box((9.5, 3.6, 13.95), (9.56, 5.57, 14.01), without="-y +y")
    hook.box((9.38, 3.2, 13.83), (9.68, 3.6, 14.13))
    hook.box((8.75, 2.5, 13.5), (10.3, 2.95, 14.5))
    return [bridge.mesh(), hook.mesh()]


def conveyor() -> list[Mesh]:
    """A belt along the hall on legs, boxes on it."""
    belt, frame, boxes = Builder("belt", "rubber"), Builder("belt_frame", "blue"), Builder("belt_boxes", "card")
    (a, b), x = BELT_Z, BELT_X
    belt.box((x - 0.5, 0.84, a), (x + 0.5, 0.92, b))
    for s in (-1, 1):
        i, j = sorted((x + s * 0.52, x + s * 0.64))
        frame.box((i, 0.74, a - 0.1), (j, 1.0, b + 0.1))
        z = a + 0.4
        while z < b:
            frame.box((i, 0, round(z, 6)), (j, 0.74, round(z + 0.12, 6)), without="-y +y")
            z += 2.35
    for k in range(15):
        z, size = a + 1.0 + 1.9 * k, 0.42 + 0.06 * (k * 5 % 4)
        boxes.block((x + 0.08 * (k % 3 - 1), 0.92, z), (size, size * 0.8, size + 0.1), turn=(k * 37) % 30 - 15, without="-y")
    return [belt.mesh(), frame.mesh(), boxes.mesh()]


def press(name: str, x: float, z: float, material: str) -> list[Mesh]:
    """A C-frame press: bed, four posts, crown, ram; a cabinet beside it."""
    p, s = Builder(name, material), Builder(f"{name}_ram", "steel")
    p.block((x, 0, z), (2.2, 0.8, 1.7), without="-y")
    for i in (-0.9, 0.9):
        for k in (-0.65, 0.65):
            p.block((x + i, 0.8, z + k), (0.3, 2.0, 0.3), without="-y +y")
    p.block((x, 2.8, z), (2.3, 0.9, 1.8))
    p.block((x - 0.3, 3.7, z), (0.8, 0.5, 0.8), without="-y")
    s.block((x, 1.9, z), (1.1, 0.9, 0.8), without="+y")
    s.block((x, 0.8, z), (1.3, 0.18, 1.0), without="-y")
    cabinet = Builder(f"{name}_cabinet", "shade").block((x + 0.1, 0, z + 1.9), (0.9, 1.7, 0.5), without="-y")
    return [p.mesh(), s.mesh(), cabinet.mesh()]


def lathe_bench(name: str, x: float, z: float) -> list[Mesh]:
    b, w = Builder(name, "green"), Builder(f"{name}_work", "steel")
    for k in (-1.1, 1.1):
        b.block((x, 0, z + k), (0.8, 0.7, 0.5), without="-y +y")
    b.block((x, 0.7, z), (0.9, 0.25, 3.0))
    b.block((x, 0.95, z - 1.1), (0.8, 0.7, 0.7), without="-y")
    b.block((x, 0.95, z + 1.2), (0.5, 0.5, 0.4), without="-y")
    bar = [(round(0.13 * cos(2 * pi * k / 10), 6), round(0.13 * sin(2 * pi * k / 10), 6)) for k in range(10)]
    for (u0, v0), (u1, v1) in zip(bar, bar[1:] + bar[:1]):
        w.face((x + u0, 1.3 + v0, z - 0.75), (x + u1, 1.3 + v1, z - 0.75), (x + u1, 1.3 + v1, z + 1.0), (x + u0, 1.3 + v0, z + 1.0))
    rack = Builder(f"{name}_rack", "orange").block((x + 2.2, 0, z), (0.7, 1.9, 2.4), without="-y")
    return [b.mesh(), w.mesh(), rack.mesh()]


def tank(name: str, x: float, z: float, material: str) -> list[Mesh]:
    t = Builder(name, material)
    t.lathe((x, 0.55, z), [(0.0, 0.0), (0.5, 0.0), (1.15, 0.5), (1.15, 2.9), (0.7, 3.35), (0.0, 3.5)], 14)
    legs = Builder(f"{name}_legs", "steel")
    for i in (-0.85, 0.75):
        for k in (-0.85, 0.75):
            legs.box((x + i, 0, z + k), (x + i + 0.1, 1.3, z + k + 0.1), without="-y +y")
    legs.box((x - 0.05, 3.95, z - 0.05), (x + 0.05, 5.0, z + 0.05), without="-y")
    return [t.mesh(), legs.mesh()]


def pallet(name: str, x: float, z: float, k: int) -> list[Mesh]:
    p = Builder(name, "card").block((x, 0, z), (1.0, 0.14, 1.2), 4 * k, without="-y")
    load = Builder(f"{name}_load", ("card", "yellow", "blue")[k % 3])
    load.block((x, 0.14, z), (0.8, 0.6, 0.95), 4 * k, without="-y")
    load.block((x, 0.74, z), (0.62, 0.5, 0.7), 4 * k + 10, without="-y")
    return [p.mesh(), load.mesh()]


def pendant(name: str, centre: Vec3) -> list[Mesh]:
    """A rod, and a shade like a frustum whose underside shines."""
    x, y, z = centre
    shade = Builder(f"{name}_shade", "shade").lathe(centre, [(0.42, -0.36), (0.16, 0.0), (0.0, 0.02)], 8)
    ring = [p for p in shade.points if p[1] == y - 0.36]
    lamp = Builder(name, "lamp").face(*ring[::-1])
    rod = Builder(f"{name}_rod", "steel").box((x - 0.02, y + 0.04, z - 0.02), (x + 0.02, 5.84, z + 0.02))
    return [shade.mesh(), lamp.mesh(), rod.mesh()]
