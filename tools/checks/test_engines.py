"""The same wall reads the same in Blender, three.js and, by its shader's arithmetic, Bevy; other forms of the pages show no other wall."""

import json
import re

import numpy as np
import pytest
from baked import bevy, camera, display
from baked.compare import blurred
from baked.gltf import Document
from baked.pages import read_page
from conftest import SAMPLES

SIZE, SAMPLES_A_SIDE = 160, 4
SCENE = SAMPLES / "cornell_box" / "cornell_box.glb"
RESOLUTION = ("--resolution", "256")
# Radiance above which a pixel shows the lamp [nit].
LAMP = 2.0


def differences(test: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Relative differences by pixel and channel, after a blur of 3 x 3, where light of that channel is seen and no lamp is near."""
    assert test.shape == reference.shape
    near_lamp = blurred((reference.max(2) > LAMP).astype(float)[..., None], 2)[..., 0] > 0
    a, b = blurred(test), blurred(reference)
    lit = ~near_lamp[..., None] & (b > 0.02 * b.mean())
    assert lit.mean() > 0.5
    return (a / np.where(lit, b, 1) - 1)[lit]


def agree(test: np.ndarray, reference: np.ndarray) -> dict[str, float]:
    d = differences(test, reference)
    found = {"bias": float(np.mean(d)), "p99": float(np.percentile(np.abs(d), 99))}
    assert abs(found["bias"]) < 0.005 and found["p99"] < 0.02, found
    return found


@pytest.fixture(scope="module")
def in_blender(bake, blender, pictures) -> np.ndarray:
    """The wall as Blender shows it from its own bake."""
    done = bake(SCENE, *RESOLUTION, "--for", "blender")
    out = pictures / "engines_blender.exr"
    blender("render_baked.py", done.glb, out, SIZE, SIZE)
    return read_page(out).rgb


def test_three_shows_the_wall_that_blender_shows(bake, three, in_blender, pictures):
    """Linear values through the same camera: irradiance and lightMapIntensity 1 here, E / pi times base colour there."""
    done = bake(SCENE, *RESOLUTION, "--for", "three")
    assert Document(done.glb).lumel()["quantity"] == "irradiance"
    shown = three(done.glb, SIZE, SIZE, SAMPLES_A_SIDE)
    exposure = display.write_png(pictures / "engines_three.png", shown, None)
    display.write_png(pictures / "engines_blender.png", in_blender, exposure)
    print(agree(shown, in_blender))


def test_standard_materials_lose_what_their_coat_reflects(bake, three, in_blender):
    """What the note says of MeshStandardMaterial: a few percent less, and no more."""
    done = bake(SCENE, *RESOLUTION, "--for", "three")
    lost = -np.mean(differences(three(done.glb, SIZE, SIZE, SAMPLES_A_SIDE, material="standard"), in_blender))
    assert 0.01 < lost < 0.05, lost


@pytest.mark.parametrize("encoding", ["hdr", "ktx2-half"])
def test_other_forms_show_the_same_wall(encoding, bake, three, in_blender):
    done = bake(SCENE, *RESOLUTION, "--encoding", "exr,hdr,ktx2-half")
    print(agree(three(done.glb, SIZE, SIZE, SAMPLES_A_SIDE, encoding=encoding), in_blender))


def test_bevy_computes_the_wall_that_blender_shows(bake, in_blender, pictures):
    done = bake(SCENE, *RESOLUTION, "--for", "bevy")
    assert [p["uri"] for p in Document(done.glb).lumel()["pages"]] == ["lightmaps/cornell_box_0.half.ktx2"]
    note = (done.folder / "cornell_box.loading.txt").read_text()
    exposure = float(re.search(r"lightmap_exposure = ([\d.]+)", note)[1])
    shown = bevy.picture(done.glb, camera.from_gltf(done.glb), SIZE, SIZE, SAMPLES_A_SIDE, exposure)
    display.write_png(pictures / "engines_bevy.png", shown, None)
    print(agree(shown, in_blender))


@pytest.mark.parametrize("engine", ["bevy", "godot", "unity", "unreal", "three", "playcanvas", "babylon", "blender", "needle", "hubs"])
def test_each_engine_gets_its_files_and_a_note(engine, bake, gltf_errors):
    done = bake(SCENE, *RESOLUTION, "--for", engine)
    note = (done.folder / "cornell_box.loading.txt").read_text()
    uris = [u for e in done.report.get("encodings", []) for u in e["uris"]] + [p["uri"] for p in done.report["pages"]]
    for uri in uris:
        assert (done.folder / uri).is_file() and uri in note, uri
    for surface in done.report["surfaces"]:
        assert surface["name"] in note
    assert gltf_errors(done.glb)[done.glb.name] == []


@pytest.mark.parametrize("extension, used", [("moz", "MOZ_lightmap"), ("mx", "MX_lightmap"), ("needle", "NEEDLE_lightmaps")])
@pytest.mark.parametrize("scene", ["cornell_box/cornell_box.glb", "sunroom/sunroom.usda"])
def test_vendor_forms_pass_the_validator(extension, used, scene, bake, gltf_errors):
    """On several pages, so that materials have to be split."""
    pages = ("--density", "16", "--page-size", "64") if "cornell" in scene else ("--density", "8", "--page-size", "128")
    done = bake(SAMPLES / scene, *pages, "--quantity", "irradiance", "--gltf-lightmap-ext", extension)
    assert gltf_errors(done.glb)[done.glb.name] == []
    doc = Document(done.glb).json
    assert used in doc["extensionsUsed"], json.dumps(doc["extensionsUsed"])
    for image in doc["images"]:
        assert "uri" not in image or (done.folder / image["uri"]).is_file(), image
