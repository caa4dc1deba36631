"""Cameras: given, the file's own, or chosen so that much is seen."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .gltf import Document


@dataclass
class Camera:
    """A pinhole; `fov` is the vertical angle [degrees]."""

    eye: np.ndarray
    target: np.ndarray
    fov: float = 45.0

    def rays(self, width: int, height: int, samples: int = 1) -> tuple[np.ndarray, np.ndarray]:
        """Origins and unit directions, (H * W * samples^2, 3), pixel by pixel from the top left."""
        forward = unit(self.target - self.eye)
        up = np.array([0, 1, 0]) if abs(forward[1]) < 0.999 else np.array([0, 0, -1])
        right = unit(np.cross(forward, up))
        up = np.cross(right, forward)
        half = np.tan(np.radians(self.fov) / 2)
        step = (np.arange(samples) + 0.5) / samples
        y, x, sy, sx = np.meshgrid(np.arange(height), np.arange(width), step, step, indexing="ij")
        px = ((x + sx) / width * 2 - 1).reshape(-1, 1) * half * width / height
        py = (1 - (y + sy) / height * 2).reshape(-1, 1) * half
        d = forward + px * right + py * up
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        return np.broadcast_to(self.eye, d.shape).copy(), d


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)


def from_gltf(path) -> Camera | None:
    """The first perspective camera of the file."""
    doc = Document(path)
    for node, world in doc.placed_nodes():
        if "camera" in node:
            camera = doc.json["cameras"][node["camera"]]
            if camera["type"] == "perspective":
                eye = world[:3, 3]
                return Camera(eye, eye - unit(world[:3, 2]), np.degrees(camera["perspective"]["yfov"]))
    return None


def candidates(low: np.ndarray, high: np.ndarray, fov: float) -> list[Camera]:
    """Views from outside along the axes and the diagonals, and from places inside, towards the middle and away from it."""
    centre, extent = (low + high) / 2, high - low
    out = []
    # Far enough that the facing side fills the height and the width of a 4:3 picture.
    for d in ([0, 0, 1], [0, 0, -1], [1, 0, 0], [-1, 0, 0], [1, 0.6, 1], [-1, 0.6, 1], [1, 0.6, -1], [-1, 0.6, -1]):
        d = unit(np.array(d, float))
        if d[1] == 0:
            across = extent[0] if d[2] else extent[2]
            away = extent[2] / 2 if d[2] else extent[0] / 2
            size = max(extent[1], across * 0.75)
        else:
            size, away = np.linalg.norm(extent) * 0.8, 0.0
        out.append(Camera(centre + d * (away + 0.53 * size / np.tan(np.radians(fov) / 2)), centre, fov))
    grid = (0.06, 0.3, 0.7, 0.94)
    for x in grid:
        for z in grid:
            eye = low + extent * np.array([x, 0.55, z])
            for target in ([0.5, 0.4, 0.5], [2 * x - 0.5, 0.4, 2 * z - 0.5]):
                out.append(Camera(eye, low + extent * np.array(target), max(fov, 65)))
    return out


def chosen(low: np.ndarray, high: np.ndarray, fov: float, render: Callable[[Camera], tuple[np.ndarray, int]]) -> Camera:
    """The candidate whose picture is the most varied: the entropy of its histogram, times the share of pixels that are lit,
    times the logarithm of the number of triangles seen; a view from outside is preferred a little. `render` gives the
    luminance (NaN: nothing hit) and that number."""

    def score(camera: Camera) -> float:
        y, seen = render(camera)
        hit = np.isfinite(y)
        lit = y[hit & (y > 0)]
        if len(lit) < 16:
            return 0.0
        top = np.percentile(lit, 95)
        counts, _ = np.histogram(np.clip(lit / top, 0, 1) ** 0.45, bins=32, range=(0, 1))
        p = counts[counts > 0] / counts.sum()
        inside = (camera.eye > low).all() and (camera.eye < high).all()
        return float(-(p * np.log(p)).sum() * len(lit) / y.size * np.log(1 + seen)) * (0.8 if inside else 1.0)

    return max(candidates(low, high, fov), key=score)
