"""Leaks and rims: the rooms of `samples/corners`, texel by texel beside what four times the density finds.

A texel's reference is the mean over the part of it that lies in the open: in no solid, and not in a crevice.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from baked import triangles
from baked.display import LUMINANCE
from baked.pages import nearest
from conftest import SAMPLES
from sample_scenes import corners

# Points along each side of a texel at which the finer bake is read, and the least share of them in the open that counts.
POINTS, LEAST = 16, 1 / 8
# A gap narrower than this share of a texel is a crevice.
CREVICE = 1 / 8
# Texels that differ from their reference by more than this share of the mean are wrong; at most these shares of all may be.
WRONG, TOO_BRIGHT, TOO_DARK = 0.2, 0.001, 0.003


def is_open(points: np.ndarray, normal: np.ndarray, solids: list, gap: float) -> np.ndarray:
    """Whether each point (N, 3) of a face is in the open: no solid begins within `gap` [m] in front of it."""
    free = np.ones(len(points), bool)
    for solid in solids:
        axes = np.array(solid.axes())
        near, far = np.full(len(points), 1e-5), np.full(len(points), gap)
        for axis, half in zip(axes, solid.half):
            at, speed = (points - solid.centre) @ axis, normal @ axis
            if abs(speed) < 1e-9:
                # Beside a face that it lies in, a point is outside.
                far[abs(at) > half - 1e-5] = -1
                continue
            a, b = (-half - at) / speed, (half - at) / speed
            near, far = np.maximum(near, np.minimum(a, b)), np.minimum(far, np.maximum(a, b))
        free &= near > far
    return free


@dataclass
class Reading:
    """Points over the pages of a coarse bake: the texel that each lies in, of the coarse pages and of the fine ones, numbered over
    all pages; what the fine bake holds there; whether the point is in the open; and the surface."""

    coarse: np.ndarray
    fine: np.ndarray
    value: np.ndarray
    free: np.ndarray
    node: np.ndarray


def texel_numbers(pages: list, page: int, uv: np.ndarray) -> np.ndarray:
    h, w = pages[page].coverage.shape
    x, y = np.clip(np.floor(uv * [w, h]).astype(int), 0, [w - 1, h - 1]).T
    return sum(p.coverage.size for p in pages[:page]) + y * w + x


def read(coarse, fine, solids: list, gap: float) -> Reading:
    """Reads the fine bake at points of every triangle."""
    np.testing.assert_allclose(coarse.position, fine.position, atol=1e-6, err_msg="the bakes differ in their triangles")
    parts = []
    for k in np.flatnonzero(coarse.page >= 0):
        size = coarse.pages[coarse.page[k]].coverage.shape[::-1]
        uv = coarse.page_uv[k] * size
        low, high = np.floor(uv.min(0)).astype(int), np.ceil(uv.max(0)).astype(int)
        x, y = (np.arange(low[i] * POINTS, high[i] * POINTS) / POINTS + 0.5 / POINTS for i in range(2))
        at = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
        v = np.linalg.solve(np.stack([uv[1] - uv[0], uv[2] - uv[0]], 1), (at - uv[0]).T).T
        weights = np.concatenate([1 - v.sum(1, keepdims=True), v], 1)
        inside = (weights > 0).all(1)
        at, weights = at[inside], weights[inside]
        normal = coarse.normals()[k]
        fine_uv = weights @ fine.page_uv[k]
        parts.append((
            texel_numbers(coarse.pages, coarse.page[k], at / size),
            texel_numbers(fine.pages, fine.page[k], fine_uv),
            nearest(fine.pages[fine.page[k]].rgb, fine_uv) @ LUMINANCE,
            is_open(weights @ coarse.position[k], normal / np.linalg.norm(normal), solids, gap),
            np.full(len(at), coarse.node[k]),
        ))
    return Reading(*(np.concatenate(p) for p in zip(*parts)))


def compare(coarse, fine, solids: list, gap: float) -> dict[str, np.ndarray]:
    """Values and references of the texels of `coarse` with enough in the open, and the surface that each lies on."""
    reading = read(coarse, fine, solids, gap)

    def total(weights: np.ndarray, texel: np.ndarray = reading.coarse) -> np.ndarray:
        return np.bincount(texel, weights, minlength=texel.max() + 1)

    # Fine texels that are partly covered hold some of the dark: they count only where there are no others.
    is_whole = total(~reading.free, reading.fine)[reading.fine] == 0
    open_count, whole_count, count = total(reading.free), total(is_whole), total(np.ones(len(is_whole)))
    used = np.where(whole_count[reading.coarse] > 0, is_whole, reading.free)
    counts = (count > 0) & (open_count >= LEAST * POINTS**2)
    node = np.zeros(len(count), int)
    node[reading.coarse] = reading.node
    values = np.concatenate([(p.rgb @ LUMINANCE).ravel() for p in coarse.pages])[: len(count)]
    reference = total(used * reading.value) / np.maximum(total(used), 1)
    return {"value": values[counts], "reference": reference[counts], "node": node[counts]}


@pytest.mark.parametrize("case", corners.cases(), ids=lambda case: case.scene.name)
def test_corners_neither_leak_nor_show_rims(case, bake):
    scene = SAMPLES / "corners" / f"{case.scene.name}.usda"
    coarse = triangles.load(bake(scene, "--density", corners.DENSITY).glb)
    fine = triangles.load(bake(scene, "--density", 4 * corners.DENSITY, "--error", "1%").glb)
    found = compare(coarse, fine, case.solids, CREVICE / corners.DENSITY)
    mean = found["reference"].mean()
    error = (found["value"] - found["reference"]) / mean
    bright, dark = (error > WRONG).mean(), (error < -WRONG).mean()
    print(f"{scene.stem}: {len(error)} texels, {bright:.3%} too bright, {dark:.3%} too dark, error {error.std():.2%} of the mean")
    for k in np.unique(found["node"][abs(error) > WRONG]):
        at = found["node"] == k
        print(f"  {coarse.names[k]}: {(error[at] > WRONG).sum()} too bright, {(error[at] < -WRONG).sum()} too dark of {at.sum()}")
    assert bright <= TOO_BRIGHT
    assert dark <= TOO_DARK
