"""`tools/picture` and `tools/preview` show a bake."""

import subprocess
import sys

import numpy as np
from conftest import TOOLS
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
