"""The EXR pages say what they hold, and their gutters are filled."""

import numpy as np
import OpenEXR
import pytest
from baked.pages import read_page
from conftest import SAMPLE_BAKES


@pytest.mark.parametrize("name", SAMPLE_BAKES)
def test_header_names_quantity_and_unit(name, bake):
    files = sorted((bake.sample(name).folder / "lightmaps").glob("*.exr"))
    assert files
    for number, file in enumerate(files):
        header = read_page(file).header
        assert (header["lumel:quantity"], header["lumel:unit"], header["lumel:page"]) == ("outgoing", "nit", number)
        assert header["compression"] == OpenEXR.ZIP_COMPRESSION
        assert not {"capDate", "owner"} & set(header)


@pytest.mark.parametrize("name", SAMPLE_BAKES)
def test_texels_are_finite_and_gutters_filled(name, bake):
    for file in sorted((bake.sample(name).folder / "lightmaps").glob("*.exr")):
        page = read_page(file)
        assert np.isfinite(page.rgb).all() and page.rgb.min() >= 0
        assert 0 <= page.coverage.min() and page.coverage.max() == 1
        covered = page.coverage > 0
        # Bilinear sampling at a chart's edge reads the texel beside it: none of them may be left black.
        lit = covered & (page.rgb.max(-1) > 0)
        beside = np.zeros_like(covered)
        beside[1:] |= lit[:-1]
        beside[:-1] |= lit[1:]
        beside[:, 1:] |= lit[:, :-1]
        beside[:, :-1] |= lit[:, 1:]
        gutter = beside & ~covered
        assert gutter.any()
        assert (page.rgb[gutter].max(-1) > 0).all(), f"{(page.rgb[gutter].max(-1) == 0).sum()} black texels beside lit ones"
