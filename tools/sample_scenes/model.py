"""A small scene in memory: what both writers need."""

from dataclasses import dataclass, field

Vec3 = tuple[float, float, float]


@dataclass
class Material:
    """Diffuse; `emission` is a radiance [nit], `texture` a PNG beside the scene that stands in place of the albedo."""

    name: str
    albedo: Vec3
    emission: Vec3 = (0.0, 0.0, 0.0)
    texture: str | None = None


@dataclass
class Mesh:
    """Polygons, counter-clockwise seen from the front; `uvs` holds one pair a corner."""

    name: str
    material: str
    points: list[Vec3]
    faces: list[list[int]]
    uvs: list[tuple[float, float]] | None = None

    def normal(self, face: list[int]) -> Vec3:
        """The unit normal of a planar polygon (Newell)."""
        n = [0.0, 0.0, 0.0]
        for k, i in enumerate(face):
            a, b = self.points[i], self.points[face[(k + 1) % len(face)]]
            n[0] += (a[1] - b[1]) * (a[2] + b[2])
            n[1] += (a[2] - b[2]) * (a[0] + b[0])
            n[2] += (a[0] - b[0]) * (a[1] + b[1])
        length = sum(v * v for v in n) ** 0.5
        return (n[0] / length, n[1] / length, n[2] / length)


@dataclass
class Camera:
    """A pinhole at `eye`, looking along +Z where `turned`, else along -Z; `fov` is its vertical angle [degrees]."""

    eye: Vec3
    fov: float
    turned: bool = False
    aspect: float = 1.0


@dataclass
class Scene:
    """Metres, Y up."""

    name: str
    comment: str
    materials: list[Material]
    meshes: list[Mesh]
    camera: Camera | None = None


@dataclass
class Builder:
    """Collects polygons into one mesh; equal points are shared."""

    name: str
    material: str
    points: list[Vec3] = field(default_factory=list)
    faces: list[list[int]] = field(default_factory=list)

    def face(self, *corners: Vec3) -> "Builder":
        indices = []
        for p in corners:
            if p not in self.points:
                self.points.append(p)
            indices.append(self.points.index(p))
        self.faces.append(indices)
        return self

    def box(self, low: Vec3, high: Vec3, without: str = "") -> "Builder":
        """An axis-aligned box, facing outwards; `without` names sides left out, such as `-z`."""
        (a, b, c), (d, e, f) = low, high
        sides = {
            "-x": [(a, b, c), (a, b, f), (a, e, f), (a, e, c)],
            "+x": [(d, b, c), (d, e, c), (d, e, f), (d, b, f)],
            "-y": [(a, b, c), (d, b, c), (d, b, f), (a, b, f)],
            "+y": [(a, e, c), (a, e, f), (d, e, f), (d, e, c)],
            "-z": [(a, b, c), (a, e, c), (d, e, c), (d, b, c)],
            "+z": [(a, b, f), (d, b, f), (d, e, f), (a, e, f)],
        }
        for side, corners in sides.items():
            if side not in without.split():
                self.face(*corners)
        return self

    def mesh(self) -> Mesh:
        return Mesh(self.name, self.material, self.points, self.faces)
