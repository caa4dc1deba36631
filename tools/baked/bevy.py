"""What Bevy shows of a baked GLB, in numbers: the arithmetic of its lightmap shader, without its renderer.

`bevy_pbr` 0.19, `lightmap.wgsl`: the rectangle is kept as four 16-bit numbers, the page's UV is mix(min, max, uv), the texel of level 0
is filtered bilinearly and multiplied by the material's `lightmap_exposure`. `pbr_functions.wgsl`: `indirect_light += lightmap_light *
diffuse_color`, with diffuse_color the base colour of a material that is no metal, and the whole times the view's exposure. The
exposure is left out here: it is the camera's.
"""

from pathlib import Path

import numpy as np

from .camera import Camera
from .gltf import Document
from .raycast import Caster
from .triangles import albedo_at, emission_at, lightmap_at, load


def unorm16(v: np.ndarray) -> np.ndarray:
    """As `pack2x16unorm` and back."""
    return np.floor(np.clip(v, 0, 1) * 65535 + 0.5) / 65535


def picture(glb: Path, camera: Camera, width: int, height: int, samples: int, lightmap_exposure: float = 1.0) -> np.ndarray:
    """Radiance (H, W, 3) [nit] with `Lightmap` components by the extras of the GLB's nodes, `samples` x `samples` rays a pixel."""
    scene = load(glb)
    lumel = [(n.get("extras") or {}).get("lumel") for n, _ in Document(glb).placed_nodes() if "mesh" in n]
    for k, place in enumerate(lumel):
        if place is None or "page" not in place:
            continue
        at = scene.node == k
        scale, offset = np.array(place["scale"]), np.array(place["offset"])
        uv = (scene.page_uv[at] - offset) / scale
        low, high = unorm16(offset), unorm16(offset + scale)
        scene.page_uv[at] = low + (high - low) * uv
    origin, direction = camera.rays(width, height, samples)
    triangle, weights = Caster(scene).closest(origin, direction)
    hit = triangle >= 0
    triangle, weights = triangle[hit], weights[hit]
    texel = np.nan_to_num(lightmap_at(scene, triangle, weights))
    diffuse_color = albedo_at(scene, triangle, weights)[:, :3]
    rgb = np.zeros((len(origin), 3))
    rgb[hit] = texel * lightmap_exposure * diffuse_color + emission_at(scene, triangle, weights)
    return rgb.reshape(height, width, samples * samples, 3).mean(2)
