"""A small scene in memory: what both writers need."""

from dataclasses import dataclass, field
from math import atan2, cos, degrees, hypot, pi, radians, sin

Vec3 = tuple[float, float, float]


@dataclass
class Transform:
    """Where a texture is read, as KHR_texture_transform has it: scaled, then turned [radians], then moved."""

    offset: tuple[float, float] = (0.0, 0.0)
    rotation: float = 0.0
    scale: tuple[float, float] = (1.0, 1.0)


@dataclass
class Material:
    """Diffuse; `emission` is a radiance [nit], `texture` a PNG beside the scene that stands in place of the albedo. The last two are
    for glTF alone: a layer has them elsewhere."""

    name: str
    albedo: Vec3
    emission: Vec3 = (0.0, 0.0, 0.0)
    texture: str | None = None
    transform: Transform | None = None
    double_sided: bool = False
    # What its glTF says beyond the diffuse, over the rest: `pbrMetallicRoughness`, `extensions`.
    looks: dict = field(default_factory=dict)


@dataclass
class Mesh:
    """Polygons, counter-clockwise seen from the front; `uvs` holds one pair a corner. `smooth`: normals are those of a ball around this
    point, in glTF."""

    name: str
    material: str
    points: list[Vec3]
    faces: list[list[int]]
    uvs: list[tuple[float, float]] | None = None
    double_sided: bool = False
    smooth: Vec3 | None = None

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
    """A pinhole at `eye`; `fov` is its vertical angle. It looks along -Z, raised by `pitch` about X, then turned by `yaw` about
    Y; all angles in degrees."""

    eye: Vec3
    fov: float
    yaw: float = 0.0
    aspect: float = 1.0
    pitch: float = 0.0

    @staticmethod
    def towards(eye: Vec3, target: Vec3, fov: float, aspect: float) -> "Camera":
        x, y, z = (b - a for a, b in zip(eye, target))
        return Camera(eye, fov, round(degrees(atan2(-x, -z)), 4), aspect, round(degrees(atan2(y, hypot(x, z))), 4))

    def quaternion(self) -> list[float]:
        """x, y, z, w."""
        p, y = radians(self.pitch) / 2, radians(self.yaw) / 2
        exact = (cos(y) * sin(p), sin(y) * cos(p), -sin(y) * sin(p), cos(y) * cos(p))
        return [int(v) if v == int(v) else v for v in (round(v, 9) for v in exact)]


@dataclass
class Place:
    """Scaled, turned about the vertical by `turn` [degrees], then moved."""

    name: str
    at: Vec3
    turn: float = 0.0
    scale: Vec3 = (1.0, 1.0, 1.0)


@dataclass
class Instances:
    """One mesh of a primitive for each of `parts`, shown in several places."""

    name: str
    parts: list[Mesh]
    places: list[Place]


@dataclass
class Scene:
    """Metres, Y up."""

    name: str
    comment: str
    materials: list[Material]
    meshes: list[Mesh]
    camera: Camera | None = None
    instances: list[Instances] = field(default_factory=list)
    # Media, in glTF alone: a node's name, its place and size, and what `extras.lumel.medium` says.
    media: list[tuple[str, Vec3, Vec3, dict]] = field(default_factory=list)


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

    def block(self, centre: Vec3, size: Vec3, turn: float = 0.0, without: str = "") -> "Builder":
        """A box whose bottom has its middle at `centre`, turned about the vertical by `turn` [degrees]; `without` as for `box`."""
        c, s = cos(radians(turn)), sin(radians(turn))
        w, h, d = size
        part = Builder("", "").box((-w / 2, 0, -d / 2), (w / 2, h, d / 2), without)
        x, y, z = centre
        return self.add(part, lambda p: (x + c * p[0] + s * p[2], y + p[1], z - s * p[0] + c * p[2]))

    def bar(self, a: Vec3, b: Vec3, width: float, height: float) -> "Builder":
        """A box from `a` to `b`, two points of one vertical plane along X or Z, without its ends."""
        dx, dy, dz = (q - p for p, q in zip(a, b))
        flat = hypot(dx, dz)
        length = hypot(flat, dy)
        along = (dx / length, dy / length, dz / length)
        side = (dz / flat, 0.0, -dx / flat) if flat > 1e-9 else (0.0, 0.0, 1.0)
        up = (
            along[1] * side[2] - along[2] * side[1],
            along[2] * side[0] - along[0] * side[2],
            along[0] * side[1] - along[1] * side[0],
        )

        def place(p: Vec3) -> Vec3:
            return tuple(o + p[2] * u + p[0] * s + p[1] * t for o, u, s, t in zip(a, along, side, up))

        w, h = width / 2, height / 2
        return self.add(Builder("", "").box((-w, -h, 0), (w, h, length), without="-z +z"), place)

    def lathe(self, centre: Vec3, profile: list[tuple[float, float]], sides: int) -> "Builder":
        """The surface that `profile`, pairs of radius and height going up, draws around the vertical through `centre`; flat facets.
        A radius of 0 closes it."""
        x, y, z = centre
        rings = [
            [(x + r * cos(2 * pi * k / sides), y + h, z - r * sin(2 * pi * k / sides)) for k in range(sides)] if r else [(x, y + h, z)] * sides
            for r, h in profile
        ]
        for (r0, _), (r1, _), low, high in zip(profile, profile[1:], rings, rings[1:]):
            for k in range(sides):
                n = (k + 1) % sides
                corners = [low[k], low[n], high[n], high[k]]
                self.face(*(corners[:1] + corners[2:] if not r0 else corners[:3] if not r1 else corners))
        return self

    def ball(self, centre: Vec3, radius: float, rows: int) -> "Builder":
        """A ball of `rows` by twice as many columns."""
        at = [(radius * sin(pi * k / rows), -radius * cos(pi * k / rows)) for k in range(rows + 1)]
        profile = [(0.0 if k in (0, rows) else r, h) for k, (r, h) in enumerate(at)]
        return self.lathe(centre, profile, 2 * rows)

    def add(self, part: "Builder", place) -> "Builder":
        """The faces of another builder, each point moved by `place`; rounded to the micrometre, so that corners that meet are equal."""
        for face in part.faces:
            self.face(*(tuple(round(v, 6) + 0.0 for v in place(part.points[i])) for i in face))
        return self

    def mesh(self, smooth: Vec3 | None = None) -> Mesh:
        return Mesh(self.name, self.material, self.points, self.faces, smooth=smooth)
