"""Parts that several rooms are made of."""

from sample_scenes.model import Builder, Mesh, Vec3


def walls(high: Vec3, materials: dict[str, str], low: Vec3 = (0.0, 0.0, 0.0)) -> list[Mesh]:
    """A closed box seen from inside: a mesh for each side, single-sided; `materials` by name of the side."""
    (a, b, c), (d, e, f) = low, high
    sides = {
        "floor": [(a, b, c), (a, b, f), (d, b, f), (d, b, c)],
        "ceiling": [(a, e, c), (d, e, c), (d, e, f), (a, e, f)],
        "left": [(a, b, c), (a, e, c), (a, e, f), (a, b, f)],
        "right": [(d, b, c), (d, b, f), (d, e, f), (d, e, c)],
        "back": [(a, b, c), (d, b, c), (d, e, c), (a, e, c)],
        "front": [(a, b, f), (a, e, f), (d, e, f), (d, b, f)],
    }
    return [Builder(name, materials[name]).face(*corners).mesh() for name, corners in sides.items() if name in materials]


def hanging_lamp(name: str, centre: Vec3, size: Vec3, housing: str, lamp: str) -> list[Mesh]:
    """A closed box below `centre` whose underside shines; the rest is its housing."""
    x, y, z = centre
    w, h, d = size[0] / 2, size[1], size[2] / 2
    low, high = (x - w, y - h, z - d), (x + w, y, z + d)
    low, high = (tuple(round(v, 6) for v in p) for p in (low, high))
    return [
        Builder(f"{name}_housing", housing).box(low, high, without="-y").mesh(),
        Builder(name, lamp).box(low, high, without="-x +x +y -z +z").mesh(),
    ]
