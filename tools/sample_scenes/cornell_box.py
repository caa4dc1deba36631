"""The measured Cornell box: geometry and spectra as published by the Cornell University Program of Computer Graphics.

The published unit is the millimetre and the box opens towards -Z. Blocks have no bottom, as published.
"""

from math import atan, degrees

from . import spectra
from .model import Builder, Camera, Material, Mesh, Scene

# The table of the publication, polygon by polygon [mm].
FLOOR = [(552.8, 0, 0), (0, 0, 0), (0, 0, 559.2), (549.6, 0, 559.2)]
LIGHT = [(343, 548.8, 227), (343, 548.8, 332), (213, 548.8, 332), (213, 548.8, 227)]
CEILING = [(556, 548.8, 0), (556, 548.8, 559.2), (0, 548.8, 559.2), (0, 548.8, 0)]
BACK_WALL = [(549.6, 0, 559.2), (0, 0, 559.2), (0, 548.8, 559.2), (556, 548.8, 559.2)]
RIGHT_WALL = [(0, 0, 559.2), (0, 0, 0), (0, 548.8, 0), (0, 548.8, 559.2)]
LEFT_WALL = [(552.8, 0, 0), (549.6, 0, 559.2), (556, 548.8, 559.2), (556, 548.8, 0)]
SHORT_BLOCK = [
    [(130, 165, 65), (82, 165, 225), (240, 165, 272), (290, 165, 114)],
    [(290, 0, 114), (290, 165, 114), (240, 165, 272), (240, 0, 272)],
    [(130, 0, 65), (130, 165, 65), (290, 165, 114), (290, 0, 114)],
    [(82, 0, 225), (82, 165, 225), (130, 165, 65), (130, 0, 65)],
    [(240, 0, 272), (240, 165, 272), (82, 165, 225), (82, 0, 225)],
]
TALL_BLOCK = [
    [(423, 330, 247), (265, 330, 296), (314, 330, 456), (472, 330, 406)],
    [(423, 0, 247), (423, 330, 247), (472, 330, 406), (472, 0, 406)],
    [(472, 0, 406), (472, 330, 406), (314, 330, 456), (314, 0, 456)],
    [(314, 0, 456), (314, 330, 456), (265, 330, 296), (265, 0, 296)],
    [(265, 0, 296), (265, 330, 296), (423, 330, 247), (423, 0, 247)],
]


def metres(p: tuple[float, float, float]) -> tuple[float, float, float]:
    return (round(p[0] / 1000, 4), round(p[1] / 1000, 4), round(p[2] / 1000, 4))


def polygons(name: str, material: str, faces: list) -> Mesh:
    builder = Builder(name, material)
    for face in faces:
        builder.face(*(metres(p) for p in face))
    return builder.mesh()


def ceiling() -> list:
    """The ceiling around the lamp's hole: the eight rectangles of a 3 x 3 grid whose corners all meet, so that no ray slips
    through where an edge would end in the middle of another."""
    xs, zs, y = [0, 213, 343, 556], [0, 227, 332, 559.2], 548.8
    return [
        [(xs[i + 1], y, zs[k]), (xs[i + 1], y, zs[k + 1]), (xs[i], y, zs[k + 1]), (xs[i], y, zs[k])]
        for i in range(3)
        for k in range(3)
        if (i, k) != (1, 1)
    ]


def scene() -> Scene:
    a, b, c, d = LEFT_WALL
    return Scene(
        "cornell_box",
        "The measured Cornell box, metres, Y up, open towards -Z. CC0.",
        [
            Material("white", spectra.albedo(spectra.WHITE)),
            Material("red", spectra.albedo(spectra.RED)),
            Material("green", spectra.albedo(spectra.GREEN)),
            Material("lamp", (spectra.LAMP_REFLECTANCE,) * 3, emission=spectra.lamp_rgb()),
        ],
        [
            polygons("floor", "white", [FLOOR]),
            polygons("ceiling", "white", ceiling()),
            polygons("back_wall", "white", [BACK_WALL]),
            polygons("right_wall", "green", [RIGHT_WALL]),
            # Its four published corners don't lie in a plane: said as two triangles, so that every reader splits it alike.
            polygons("left_wall", "red", [[a, b, c], [a, c, d]]),
            polygons("short_block", "white", SHORT_BLOCK),
            polygons("tall_block", "white", TALL_BLOCK),
            polygons("lamp", "lamp", [LIGHT]),
        ],
        # Published: at 278 273 -800, focal length 0.035, film 0.025 by 0.025.
        Camera((0.278, 0.273, -0.8), round(degrees(2 * atan(0.0125 / 0.035)), 4), yaw=180),
    )
