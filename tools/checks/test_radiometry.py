"""Numbers known without a renderer: the furnace, the energy balance, sunlight on the floor."""

import numpy as np
import pytest
from baked import triangles
from baked.energy import incident_from_rays, incident_from_texels
from baked.raycast import Caster
from conftest import SAMPLE_BAKES
from sample_scenes import furnace, sunroom


@pytest.mark.parametrize("name", ["furnace.glb", "furnace.usda"])
def test_furnace_is_exact_at_every_texel(name, bake):
    scene = triangles.load(bake.sample(name).glb)
    expected = furnace.RADIANCE / (1 - furnace.ALBEDO)
    for page in scene.pages:
        covered = page.rgb[page.coverage > 0]
        assert len(covered) > 500
        error = np.abs(covered / expected - 1)
        assert error.max() <= 0.005, f"worst texel {error.max():.2%} off {expected} nit, mean {covered.mean():.5f}"


@pytest.mark.parametrize("name", SAMPLE_BAKES)
def test_reported_energy_balance_closes(name, bake):
    energy = bake.sample(name).report["energy"]
    assert abs(energy["imbalance"]) <= 0.003, energy


@pytest.mark.parametrize("name", ["cornell_box.glb", "cornell_box.usda", "furnace.glb"])
def test_energy_balance_closes_by_independent_rays(name, bake):
    """What the surfaces send out, followed along random rays to where it lands, is what the texels say they receive."""
    scene = triangles.load(bake.sample(name).glb)
    caster = Caster(scene)
    received = incident_from_texels(scene, caster)
    landed = incident_from_rays(scene, caster, rays=2_000_000)
    assert landed == pytest.approx(received, rel=0.005)


def test_sunlight_draws_the_window_on_the_floor(bake):
    """In the patch a texel holds the sun's E / pi and some light of the room; beside it far less."""
    scene = triangles.load(bake.sample("sunroom.usda").glb)
    travel = np.array(sunroom.sun_direction())
    sunlight = sunroom.SUN_LUX * -travel[2] / np.pi

    def floor(x: float, y: float) -> float:
        """Red at a point of the floor; the bake is Y up."""
        origin = np.array([[x, 0.3, -y]])
        triangle, weights = Caster(scene).closest(origin, np.array([[0.0, -1.0, 0.0]]))
        assert "floor" in scene.names[scene.node[triangle[0]]]
        return float(triangles.lightmap_at(scene, triangle, weights)[0, 0])

    # Points of the window plane, followed along the sun to the floor: right of the bar, away from table and chairs.
    for x, z in ((3.3, 1.2), (3.5, 1.3)):
        reach = z / -travel[2]
        value = floor(x + travel[0] * reach, travel[1] * reach)
        assert sunlight < value < 1.25 * sunlight, f"{value:.0f} nit in the sun, {sunlight:.0f} from the sun alone"
    shade = floor(4.7, 3.7)
    assert 0 < shade < 0.15 * sunlight
