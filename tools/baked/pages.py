"""Lightmap pages: EXR files with R G B and coverage in A."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np


@dataclass
class Page:
    """A page; row 0 is the top."""

    rgb: np.ndarray
    coverage: np.ndarray
    header: dict = field(default_factory=dict)


def read_page(path: Path | str) -> Page:
    """Reads an EXR page; coverage is 1 where the file has no alpha."""
    import OpenEXR

    with OpenEXR.File(str(path)) as f:
        channels, header = f.parts[0].channels, dict(f.parts[0].header)
        if "RGBA" in channels:
            rgba = np.asarray(channels["RGBA"].pixels, np.float32)
            return Page(rgba[..., :3].copy(), rgba[..., 3].copy(), header)
        if "RGB" in channels:
            rgb = np.asarray(channels["RGB"].pixels, np.float32)
        else:
            rgb = np.stack([np.asarray(channels[c].pixels, np.float32) for c in "RGB"], -1)
        alpha = np.asarray(channels["A"].pixels, np.float32) if "A" in channels else np.ones(rgb.shape[:2], np.float32)
        return Page(rgb.copy(), alpha.copy(), header)


def nearest(image: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Rows of `image` at `uv` (N, 2), v down: the texel that holds each point, unfiltered."""
    h, w = image.shape[:2]
    x, y = np.floor(uv[:, 0] * w).astype(int), np.floor(uv[:, 1] * h).astype(int)
    return image[np.clip(y, 0, h - 1), np.clip(x, 0, w - 1)]


def bilinear(image: np.ndarray, uv: np.ndarray, wrap: bool = False) -> np.ndarray:
    """Rows of `image` at `uv` (N, 2), v down, texel centres at (i + 0.5) / size; clamped at the edge, or repeated."""
    h, w = image.shape[:2]
    x, y = uv[:, 0] * w - 0.5, uv[:, 1] * h - 0.5
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - x0)[:, None], (y - y0)[:, None]

    def at(i, j):
        if wrap:
            return image[j % h, i % w]
        return image[np.clip(j, 0, h - 1), np.clip(i, 0, w - 1)]

    top = at(x0, y0) * (1 - fx) + at(x0 + 1, y0) * fx
    return top * (1 - fy) + (at(x0, y0 + 1) * (1 - fx) + at(x0 + 1, y0 + 1) * fx) * fy
