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


def incident_from_texels(scene: Triangles, count: int = 2_000_000) -> np.ndarray:
    """Flux that the lightmap says arrives at all fronts, RGB [lm]."""
    triangle, weights, _ = points(scene, count)
    return np.pi * np.nan_to_num(lightmap_at(scene, triangle, weights)).mean(0) * scene.areas().sum()


def incident_from_rays(scene: Triangles, caster: Caster, rays: int) -> np.ndarray:
    """Flux that arrives at fronts when each point sends out its radiosity, RGB [lm]. Backs absorb."""
    triangle, weights, u = points(scene, rays)
    normals = scene.normals()
    unit = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    total = np.zeros(3)
    for part in np.array_split(np.arange(rays), max(1, rays // 500_000)):
        t, w = triangle[part], weights[part]
        n = unit[t]
        sent = np.pi * radiance_at(scene, t, w)
        other = np.where(np.abs(n[:, :1]) > 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
        across = np.cross(n, other)
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        along = np.cross(n, across)
        radius, angle = np.sqrt(u[part, 0])[:, None], 2 * np.pi * u[part, 1][:, None]
        height = np.sqrt(np.maximum(1 - radius**2, 0))
        direction = radius * (np.cos(angle) * across + np.sin(angle) * along) + height * n
        origin = (scene.position[t] * w[..., None]).sum(1) + n * caster.step
        hit = caster.first(origin, direction)
        lands = (hit >= 0) & ((normals[hit] * direction).sum(1) < 0)
        total += sent[lands].sum(0)
    return total / rays * scene.areas().sum()
