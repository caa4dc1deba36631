"""The Cornell boxes of 1984 and 1985.

1984: Goral, Torrance, Greenberg, Battaile, "Modeling the Interaction of Light Between Diffuse Surfaces": an empty cube, one side
of which is a diffuse source. 1985: Cohen, Greenberg, "The Hemi-Cube: A Radiosity Solution for Complex Environments": a cube with
two boxes in it, a source in the ceiling. The reflectances are ours; the papers give pictures and few numbers.
"""

from sample_scenes.model import Builder, Camera, Material, Scene

from . import room

RED, BLUE, WHITE, GREY = (0.6, 0.08, 0.06), (0.08, 0.14, 0.55), (0.75, 0.75, 0.75), (0.5, 0.5, 0.5)


def scene_1984() -> Scene:
    """A cube of 1 m: red left, blue right, white back, grey floor and ceiling; the open front is a black diffuse source of
    10 nit. The camera looks in through the source's back."""
    materials = [
        Material("red", RED),
        Material("blue", BLUE),
        Material("white", WHITE),
        Material("grey", GREY),
        Material("source", (0.0, 0.0, 0.0), emission=(10.0, 10.0, 10.0)),
    ]
    sides = {"floor": "grey", "ceiling": "grey", "left": "red", "right": "blue", "back": "white", "front": "source"}
    return Scene("box_1984", "The Cornell box of 1984. CC0.", materials, room.walls((1, 1, 1), sides), Camera((0.5, 0.5, 2.35), 41.5))


def scene_1985() -> Scene:
    """A cube of 1 m: red left, blue right, the rest white; a tall and a low white box, a source of 0.3 x 0.3 m under the
    ceiling. The camera looks in through the back of the front wall."""
    materials = [
        Material("red", RED),
        Material("blue", BLUE),
        Material("white", WHITE),
        Material("housing", (0.3, 0.3, 0.3)),
        Material("source", (0.0, 0.0, 0.0), emission=(30.0, 29.0, 26.0)),
    ]
    sides = {"floor": "white", "ceiling": "white", "left": "red", "right": "blue", "back": "white", "front": "white"}
    tall = Builder("tall_box", "white").block((0.33, 0, 0.35), (0.28, 0.58, 0.28), turn=18, without="-y")
    low = Builder("low_box", "white").block((0.67, 0, 0.66), (0.28, 0.28, 0.28), turn=-17, without="-y")
    meshes = room.walls((1, 1, 1), sides) + [tall.mesh(), low.mesh()]
    meshes += room.hanging_lamp("source", (0.5, 0.985, 0.5), (0.3, 0.015, 0.3), "housing", "source")
    return Scene("box_1985", "The Cornell box of 1985. CC0.", materials, meshes, Camera((0.5, 0.5, 2.35), 41.5))
