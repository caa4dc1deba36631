"""Lightmap pages: EXR files with R G B and coverage in A, and KTX2 files of half floats."""

import struct
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
    """Reads a page; coverage is 1 where the file has no alpha."""
    if Path(path).suffix == ".ktx2":
        return read_ktx2(path)
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


def read_ktx2(path: Path | str) -> Page:
    """Reads level 0 of a KTX2 page of half floats (KTX File Format Specification 2.0, section 3)."""
    data = Path(path).read_bytes()
    form, _, width, height = struct.unpack_from("<4I", data, 12)
    if data[1:7] != b"KTX 20" or form != 97:
        raise ValueError(f"{path}: is no KTX2 file of VK_FORMAT_R16G16B16A16_SFLOAT")
    offset, size = struct.unpack_from("<2Q", data, 80)
    rgba = np.frombuffer(data[offset : offset + size], "<f2").reshape(height, width, 4).astype(np.float32)
    return Page(rgba[..., :3].copy(), rgba[..., 3].copy())


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
