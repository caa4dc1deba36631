"""A room of several pages, textures that are scaled, turned and moved, double-sided sheets and instances reads the same in three.js, in
Blender and by the pages' own numbers; a wrong page or rectangle of any surface would show."""

import dataclasses

import numpy as np
import pytest
from baked import camera, display, triangles
from baked.pages import read_page
from baked.raycast import Caster
from sample_scenes import gallery

SIZE, SAMPLES_A_SIDE = 240, 4
# What the camera sees with a margin; the lamp above shows no lightmap's light.
SEEN = {"floor", "ceiling", "left", "right", "back", "screen_front", "screen_back", "crate_1", "crate_2", "crate_3"}
TEXEL = 1 / 64


@pytest.fixture(scope="module")
def baked(bake, tmp_path_factory):
    scene = gallery.write(tmp_path_factory.mktemp("gallery"))
    return bake(scene, "--for", "three", "--density", "12", "--page-size", "64")


class View:
    """What the file's camera sees by the pages' own numbers."""

    def __init__(self, glb):
        self.scene = triangles.load(glb)
        origin, direction = camera.from_gltf(glb).rays(SIZE, SIZE, SAMPLES_A_SIDE)
        self.triangle, self.weights = Caster(self.scene).closest(origin, direction)
        assert (self.triangle >= 0).all()
        self.shown = self.nodes()

    def picture(self, scene=None, node: int | None = None) -> np.ndarray:
        """The file's own scene or one like it; of one node alone, the rest black."""
        rgb = np.zeros((len(self.triangle), 3))
        at = np.full(len(rgb), True) if node is None else self.scene.node[self.triangle] == node
        rgb[at] = triangles.radiance_at(scene or self.scene, self.triangle[at], self.weights[at])
        return rgb.reshape(SIZE, SIZE, -1, 3).mean(2)

    def nodes(self) -> np.ndarray:
        """The node that each pixel and its neighbours show alone, -1: none."""
        shown = self.scene.node[self.triangle].reshape(SIZE, SIZE, -1)
        around = np.pad(shown, ((1, 1), (1, 1), (0, 0)), mode="edge")
        parts = np.concatenate([around[j : j + SIZE, i : i + SIZE] for j in range(3) for i in range(3)], axis=2)
        return np.where((parts == parts[..., :1]).all(2), parts[..., 0], -1)

    def differences(self, test: np.ndarray, reference: np.ndarray) -> dict[str, tuple[float, float]]:
        """By surface: of the mean of a channel, the largest; and of a pixel, that which 95 of 100 keep below."""
        assert test.shape == reference.shape
        found = {}
        for k, name in enumerate(self.scene.names):
            at = self.shown == k
            if name in SEEN and at.sum() >= 100:
                a, b = test[at], reference[at]
                pixels = np.abs(a - b).max(1) / b.max(1)
                found[name] = (float(np.abs(a.mean(0) / b.mean(0) - 1).max()), float(np.percentile(pixels, 95)))
        return found


@pytest.fixture(scope="module")
def view(baked):
    return View(baked.glb)


@pytest.fixture(scope="module")
def in_three(baked, three, pictures) -> np.ndarray:
    shown = three(baked.glb, SIZE, SIZE, SAMPLES_A_SIDE)
    display.write_png(pictures / "gallery_three.png", shown, None)
    return shown


def is_beyond(mean: float, p95: float) -> bool:
    """More than two renderers of the same pages differ: they agree within 0.1 %."""
    return mean > 0.005 or p95 > 0.01


def test_three_shows_what_the_pages_say(view, in_three):
    assert len(set(view.scene.page[view.scene.page >= 0])) >= 3
    found = view.differences(in_three, view.picture())
    print(found)
    assert set(found) == SEEN and not any(is_beyond(*k) for k in found.values()), found


def test_blender_shows_what_three_shows(baked, view, in_three, blender, pictures):
    """Its samples lie elsewhere in a pixel, so that pixels with an edge of the texture differ: surfaces by their mean."""
    out = pictures / "gallery_blender.exr"
    assert blender("render_baked.py", baked.glb, out, SIZE, SIZE)["surfaces"] == len(view.scene.names)
    shown = read_page(out).rgb
    display.write_png(pictures / "gallery_blender.png", shown, None)
    found = view.differences(in_three, shown)
    print(found)
    assert set(found) == SEEN and max(mean for mean, _ in found.values()) < 0.01, found


def test_a_wrong_page_or_rectangle_of_any_surface_shows(view):
    """What the limits above can see: each surface, read from each other page or two texels aside, is beyond them."""
    right = view.picture()
    for k, name in enumerate(view.scene.names):
        if name not in SEEN:
            continue
        at = view.scene.node == k
        wrong = []
        for page in set(range(len(view.scene.pages))) - set(view.scene.page[at]):
            wrong.append(dataclasses.replace(view.scene, page=np.where(at, page, view.scene.page)))
        for aside in ([2, 0], [0, 2], [-2, 0], [0, -2]):
            moved = view.scene.page_uv + at[:, None, None] * np.array(aside) * TEXEL
            wrong.append(dataclasses.replace(view.scene, page_uv=moved))
        for scene in wrong:
            found = view.differences(view.picture(scene, k), right)[name]
            assert is_beyond(*found), (name, found)
