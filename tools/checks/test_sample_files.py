"""The committed samples are what `tools/make_samples` writes."""

import subprocess
import sys

import pytest
from conftest import SAMPLES, TOOLS
from pxr import Usd, UsdValidation


def test_generator_writes_the_same_bytes(tmp_path):
    subprocess.run([sys.executable, TOOLS / "make_samples", tmp_path], check=True)
    files = [f.relative_to(tmp_path) for f in tmp_path.rglob("*") if f.is_file()]
    assert len(files) == 13
    for f in files:
        assert (SAMPLES / f).read_bytes() == (tmp_path / f).read_bytes(), f"samples/{f} is out of date: run tools/make_samples"


@pytest.mark.parametrize("file", sorted(f.relative_to(SAMPLES) for f in SAMPLES.glob("*/*.usda")), ids=str)
def test_usd_is_valid(file):
    stage = Usd.Stage.Open(str(SAMPLES / file))
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    assert [e.GetMessage() for e in context.Validate(stage)] == []


@pytest.mark.parametrize("name", ["cornell_box", "furnace"])
def test_gltf_is_valid(name, gltf_errors):
    assert gltf_errors(SAMPLES / name / f"{name}.glb") == {f"{name}.glb": []}
