"""A closed box in which every wall emits alike and reflects alike: the radiance is L / (1 - rho) everywhere."""

from .model import Camera, Material, Mesh, Scene

SIZE = (1.0, 0.8, 1.2)
ALBEDO = 0.5
RADIANCE = 1.0


def scene() -> Scene:
    x, y, z = SIZE
    corners = [(i * x, j * y, k * z) for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    walls = {
        "floor": [0, 1, 5, 4],
        "ceiling": [2, 6, 7, 3],
        "left": [0, 2, 3, 1],
        "right": [4, 5, 7, 6],
        "back": [0, 4, 6, 2],
        "front": [1, 3, 7, 5],
    }
    return Scene(
        "furnace",
        f"Every wall emits {RADIANCE:g} nit and reflects {ALBEDO:g}, facing inwards: every texel is "
        f"{RADIANCE / (1 - ALBEDO):g} nit. CC0.",
        [Material("wall", (ALBEDO,) * 3, emission=(RADIANCE,) * 3)],
        [Mesh(name, "wall", [corners[i] for i in face], [[0, 1, 2, 3]]) for name, face in walls.items()],
        Camera((0.5, 0.4, 1.1), 70.0),
    )
