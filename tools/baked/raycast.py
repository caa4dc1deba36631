"""What a camera sees of a baked scene: one ray a sample, the lightmap times the albedo. No light is computed here."""

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from .camera import Camera
from .display import LUMINANCE
from .triangles import Triangles, albedo_at, radiance_at


class Caster:
    """Nearest visible surface along rays: backs of single-sided materials and masked holes let a ray pass, as in an engine."""

    def __init__(self, triangles: Triangles):
        self.triangles = triangles
        self.scene = rtcore_scene.EmbreeScene()
        self.mesh = TriangleMesh(self.scene, triangles.position.astype(np.float32))
        self.normals = triangles.normals()
        span = np.ptp(triangles.position.reshape(-1, 3), axis=0).max()
        self.step = 1e-5 * float(span)

    def closest(self, origin: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Triangle (-1: none) and barycentric weights for each ray."""
        t = self.triangles
        found = np.full(len(origin), -1)
        weights = np.zeros((len(origin), 3))
        live, start = np.arange(len(origin)), origin.copy()
        sided = np.array([look.double_sided for look in t.looks])
        cutoff = np.array([-1.0 if look.cutoff is None else look.cutoff for look in t.looks])
        for _ in range(32):
            hit = self.scene.run(start[live].astype(np.float32), direction[live].astype(np.float32), output=1)
            ok = hit["primID"] >= 0
            live, k = live[ok], hit["primID"][ok]
            u, v, far = hit["u"][ok], hit["v"][ok], hit["tfar"][ok]
            w = np.stack([1 - u - v, u, v], 1)
            seen = sided[t.look[k]] | ((self.normals[k] * direction[live]).sum(1) < 0)
            masked = seen & (cutoff[t.look[k]] >= 0)
            if masked.any():
                opaque = albedo_at(t, k[masked], w[masked])[:, 3] >= cutoff[t.look[k[masked]]]
                seen[masked] = opaque
            found[live[seen]], weights[live[seen]] = k[seen], w[seen]
            rest = ~seen
            start[live[rest]] += direction[live[rest]] * (far[rest, None] + self.step)
            live = live[rest]
            if not len(live):
                break
        return found, weights

    def first(self, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """The first triangle along each ray whatever side it shows, -1: none."""
        return self.scene.run(origin.astype(np.float32), direction.astype(np.float32), output=1)["primID"]

    def hidden(self, triangle: np.ndarray, weights: np.ndarray, near: float = 0.01) -> np.ndarray:
        """Points that nobody sees: something is as near as `near` [m] right before them, or shows them its back."""
        normal = self.normals[triangle] / np.linalg.norm(self.normals[triangle], axis=1, keepdims=True)
        place = (self.triangles.position[triangle] * weights[..., None]).sum(1) + 1e-4 * normal
        hit = self.scene.run(place.astype(np.float32), normal.astype(np.float32), output=1)
        facing = (self.normals[hit["primID"]] * normal).sum(1)
        return (hit["primID"] >= 0) & ((facing > 0) | (hit["tfar"] < near))

    def picture(self, camera: Camera, width: int, height: int, samples: int = 2) -> tuple[np.ndarray, np.ndarray]:
        """Radiance (H, W, 3) [nit], and the share of each pixel that a surface covers (H, W)."""
        origin, direction = camera.rays(width, height, samples)
        triangle, weights = self.closest(origin, direction)
        rgb = np.zeros((len(origin), 3))
        hit = triangle >= 0
        rgb[hit] = radiance_at(self.triangles, triangle[hit], weights[hit])
        shape = (height, width, samples * samples)
        return rgb.reshape(*shape, 3).mean(2), hit.reshape(shape).mean(2)

    def glance(self, camera: Camera, width: int = 64, height: int = 48) -> tuple[np.ndarray, int]:
        """A small picture for choosing a camera: luminance, NaN where nothing is hit; and how many triangles are seen."""
        origin, direction = camera.rays(width, height)
        triangle, weights = self.closest(origin, direction)
        hit = triangle >= 0
        luminance = np.full(len(hit), np.nan)
        luminance[hit] = radiance_at(self.triangles, triangle[hit], weights[hit]) @ LUMINANCE
        return luminance, len(np.unique(triangle[hit]))
