"""`tools/picture` and `tools/preview` show a bake."""

import subprocess
import sys

import numpy as np
from conftest import SAMPLES, TOOLS
from PIL import Image


def test_picture_and_preview_write_png(bake, pictures):
    for name in ("cornell_box.glb", "sunroom.usda"):
        done = bake.sample(name)
        png = pictures / f"{done.scene.stem}_{done.scene.suffix[1:]}_picture.png"
        subprocess.run([sys.executable, TOOLS / "picture", done.glb, "-o", png, "--size", "320x240"], check=True)
        shown = np.asarray(Image.open(png).convert("L"), float)
        assert shown.std() > 20, f"{png} shows next to nothing"
        page = pictures / f"{done.scene.stem}_{done.scene.suffix[1:]}_page.png"
        subprocess.run([sys.executable, TOOLS / "preview", done.folder, "-o", page], check=True)
        assert page.exists()


def test_picture_shows_other_pages(bake, tmp_path):
    """The pages of a watched step in place of the bake's own, texels unfiltered."""
    done = bake(SAMPLES / "cornell_box/cornell_box.glb", "--resolution", "64", "--solver", "progressive", "--iterations", 8,
                "--watch", tmp_path / "steps", "--watch-every", 4)
    png = tmp_path / "step.png"
    command = [sys.executable, TOOLS / "picture", done.glb, "-o", png, "--size", "160x120", "--flat", "--pages"]
    subprocess.run([*command, tmp_path / "steps" / "000004_"], check=True)
    assert np.asarray(Image.open(png).convert("L"), float).std() > 20
    missing = subprocess.run([*command, tmp_path / "steps" / "000005_"], capture_output=True, text=True)
    assert missing.returncode == 1 and "no such page" in missing.stderr, missing.stderr
