"""A small stage: a slide thrown askew at a backdrop, a measured lamp beside a wall, and a lamp for one thing alone; metres, Y up."""

from math import asin, atan2, cos, degrees, radians

from . import png, usda
from .model import Builder, Material, Mesh

MATERIALS = "/projector/materials"
EYE, AIM = (1.5, 0.35, 1.5), (0.2, 1.3, -1.0)  # the projector, low and to the side, and the middle of its picture
FOV, SIZE = 32.0, (96, 72)
CANDELA = 900.0
LAMP = (-1.55, 2.1, -0.75)
ACCENT = (-0.9, 1.9, 0.9)


def meshes() -> list[Mesh]:
    floor = Builder("floor", "boards").face((-2, 0, -1), (-2, 0, 2), (2, 0, 2), (2, 0, -1))
    backdrop = Builder("backdrop", "cloth").face((-2, 0, -1), (2, 0, -1), (2, 2.4, -1), (-2, 2.4, -1))
    side = Builder("side", "cloth").face((-2, 0, 2), (-2, 0, -1), (-2, 2.4, -1), (-2, 2.4, 2))
    plinth = Builder("plinth", "stone").block((-0.9, 0, 0.3), (0.3, 0.7, 0.3), 25, without="-y")
    return [m.mesh() for m in (floor, backdrop, side, plinth)]


def slide() -> bytes:
    """Colours in squares within a frame, an arrow up and a bar to its right: whatever is turned or mirrored shows."""
    width, height = SIZE
    palette = [(20, 20, 24), (255, 255, 255), (214, 40, 40), (40, 160, 70), (40, 80, 210), (240, 200, 40), (60, 60, 66)]
    rows = []
    for y in range(height):
        row = bytearray()
        for x in range(width):
            rim = min(x, y, width - 1 - x, height - 1 - y)
            if rim < 3:
                row.append(1)
            elif x < 30:
                row.append(2 + (x // 10 + y // 12) % 4)
            elif abs(x - 54) <= 2 and 22 <= y < 58 or 12 <= y < 28 and abs(x - 54) <= y - 12:
                row.append(1)
            elif 78 <= x < 84 and 12 <= y < 60:
                row.append(5)
            else:
                row.append(6 if x % 12 == 0 or y % 12 == 0 else 0)
        rows.append(bytes(row))
    return png.paletted(width, rows, palette)


def profile() -> str:
    """A narrow downlight with a little light to the side, 30 degrees to half of it; its lamp is made up."""
    vertical = list(range(0, 91, 5))
    intensity = [620 * max(cos(radians(v)), 0.0) ** 5 + 40 * max(cos(radians(v)), 0.0) for v in vertical]
    return (
        "IES:LM-63-2019\n[TEST] none: made up for a sample\n[MANUFAC] none\n[LUMINAIRE] downlight\nTILT=NONE\n"
        f"1 -1 1 {len(vertical)} 1 1 2 0 0 0\n1 1 9\n{' '.join(map(str, vertical))}\n0\n"
        f"{' '.join(f'{v:.2f}' for v in intensity)}\n"
    )


def point(name: str, eye, aim, intensity: float, more: str) -> str:
    """A light of `intensity` cd (a normalized point has a quarter of its number), turned so that it shines from `eye` to `aim`."""
    x, y, z = (b - a for a, b in zip(eye, aim))
    length = (x * x + y * y + z * z) ** 0.5
    tip, turn = degrees(asin(y / length)), degrees(atan2(-x, -z)) if x or z else 0.0
    body = (
        f"{more}float inputs:intensity = {usda.number(4 * intensity)}\nbool inputs:normalize = 1\nfloat inputs:radius = 0.02\n"
        "bool treatAsPoint = 1\n"
        f"double3 xformOp:rotateXYZ = {usda.tuple_of((round(tip, 4), round(turn, 4), 0))}\n"
        f"double3 xformOp:translate = {usda.tuple_of(eye)}\n"
        'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]\n'
    )
    return f'def SphereLight "{name}" (\n    prepend apiSchemas = ["ShapingAPI"]\n)\n{{\n{usda.indent(body)}}}\n\n'


def lights() -> str:
    throw = (
        f"float inputs:shaping:cone:angle = 60\ncustom asset lumel:projector = @./slide.png@\n"
        f"custom float lumel:projector:fov = {usda.number(FOV)}\ncustom rel lumel:projector:target = </projector/backdrop>\n"
    )
    measured = "asset inputs:shaping:ies:file = @./downlight.ies@\nfloat inputs:shaping:cone:angle = 180\n"
    accent = (
        "color3f inputs:color = (1, 0.7, 0.4)\nrel collection:lightLink:includes = </projector/plinth>\n"
        "uniform bool collection:lightLink:includeRoot = 0\nfloat inputs:shaping:cone:angle = 30\n"
    )
    below = (LAMP[0], 0.0, LAMP[2])
    return (
        point("slide", EYE, AIM, CANDELA, throw)
        + point("downlight", LAMP, below, 1.0, measured)
        + point("accent", ACCENT, (-0.9, 0.5, 0.3), 120.0, accent)
    )


def camera() -> str:
    body = (
        "float2 clippingRange = (0.01, 1000)\nfloat focalLength = 22\nfloat horizontalAperture = 32\nfloat verticalAperture = 24\n"
        "double3 xformOp:rotateXYZ = (-6, 0, 0)\ndouble3 xformOp:translate = (0, 1.45, 3.4)\n"
        'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]\n'
    )
    return f'def Camera "camera"\n{{\n{usda.indent(body)}}}\n\n'


def write() -> str:
    materials = [
        Material("boards", (0.32, 0.24, 0.17)),
        Material("cloth", (0.7, 0.7, 0.72)),
        Material("stone", (0.55, 0.53, 0.5)),
    ]
    body = "".join(usda.mesh(m, MATERIALS) for m in meshes())
    body += lights() + camera() + usda.scope("materials", "".join(usda.material(m, MATERIALS) for m in materials))
    return usda.layer("A stage with a projector, a measured lamp and a linked one, metres, Y up. CC0.", "projector", body)
