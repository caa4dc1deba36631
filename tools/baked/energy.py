"""The energy balance of a baked scene that is lit by its own surfaces, from the texels alone.

Flux received, `sum E A` over all fronts, is computed twice: from the texels, and from what each point sends out (emission and
reflected light, both from the bake) followed along one cosine-distributed ray each to where it lands.
"""

import numpy as np

from .raycast import Caster
from .triangles import Triangles, lightmap_at, radiance_at

GOLDEN = (0.7548776662466927, 0.5698402909980532, 0.8191725133961645, 0.6710436067037893)


def points(scene: Triangles, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`count` points uniform by area: triangle, barycentric weights, and two more numbers in 0..1 each (a fixed sequence)."""
    areas = scene.areas()
    triangle = np.searchsorted(np.cumsum(areas) / areas.sum(), (np.arange(count) + 0.5) / count)
    triangle = np.minimum(triangle, len(areas) - 1)
    # Additive recurrences with the generalised golden ratios: even in every pair of dimensions.
    u = np.stack([(0.5 + np.arange(count) * g) % 1 for g in GOLDEN], 1)
    root = np.sqrt(u[:, 0])
    weights = np.stack([1 - root, root * (1 - u[:, 1]), root * u[:, 1]], 1)
    return triangle, weights, u[:, 2:]


def cosine_rays(normal: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Unit directions about `normal` (N, 3), distributed as the cosine, from `u` (N, 2)."""
    other = np.where(np.abs(normal[:, :1]) > 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    across = np.cross(normal, other)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    along = np.cross(normal, across)
    radius, angle = np.sqrt(u[:, :1]), 2 * np.pi * u[:, 1:]
    height = np.sqrt(np.maximum(1 - radius**2, 0))
    return radius * (np.cos(angle) * across + np.sin(angle) * along) + height * normal


def lands(scene: Triangles, caster: Caster, triangle: np.ndarray, weights: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For a cosine-distributed ray from each point: whether it meets a front, and whether it meets a back."""
    normals = scene.normals()
    n = normals[triangle] / np.linalg.norm(normals[triangle], axis=1, keepdims=True)
    direction = cosine_rays(n, u)
    origin = (scene.position[triangle] * weights[..., None]).sum(1) + n * caster.step
    hit = caster.first(origin, direction)
    facing = (normals[hit] * direction).sum(1)
    return (hit >= 0) & (facing < 0), (hit >= 0) & (facing >= 0)


def incident_from_texels(scene: Triangles, caster: Caster, count: int = 600_000) -> np.ndarray:
    """Flux that the lightmap says arrives at all fronts, RGB [lm]. Points inside other geometry, which see backs all around,
    receive nothing: what their texels hold is filled in for display."""
    triangle, weights, u = points(scene, count)
    backs = np.zeros(count)
    for k in range(8):
        turned = (u + np.array(GOLDEN[:2]) * k) % 1
        backs += lands(scene, caster, triangle, weights, turned)[1]
    value = np.where((backs > 6)[:, None], 0, np.nan_to_num(lightmap_at(scene, triangle, weights)))
    return np.pi * value.mean(0) * scene.areas().sum()


def incident_from_rays(scene: Triangles, caster: Caster, rays: int) -> np.ndarray:
    """Flux that arrives at fronts when each point sends out its radiosity, RGB [lm]. Backs absorb."""
    triangle, weights, u = points(scene, rays)
    total = np.zeros(3)
    for part in np.array_split(np.arange(rays), max(1, rays // 500_000)):
        front, _ = lands(scene, caster, triangle[part], weights[part], u[part])
        total += np.pi * radiance_at(scene, triangle[part], weights[part])[front].sum(0)
    return total / rays * scene.areas().sum()
