"""The same scene and settings give the same bytes, whatever the number of threads."""

import pytest
from conftest import SAMPLES


@pytest.mark.parametrize("path", ["cornell_box/cornell_box.glb", "sunroom/sunroom.usda"])
def test_threads_do_not_change_a_byte(path, bake):
    scene = SAMPLES / path
    settings = ("--quality", "draft", "--resolution", "128")
    one = bake(scene, *settings, "--threads", "1").folder
    two = bake(scene, *settings, "--threads", "2").folder
    files = sorted(f.relative_to(one) for f in one.rglob("*") if f.suffix in (".exr", ".glb", ".usda"))
    assert len(files) >= 3
    for f in files:
        assert (one / f).read_bytes() == (two / f).read_bytes(), f"{f} differs between one thread and two"
