"""Linear light to a picture for people: exposure, tone curve, sRGB, PNG."""

from pathlib import Path

import numpy as np

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def auto_exposure(rgb: np.ndarray, percentile: float = 90.0, level: float = 0.7) -> float:
    """The factor that takes the given percentile of the luminance of `rgb` (N, 3) to `level`; 1 where all is black."""
    y = rgb @ LUMINANCE
    y = y[np.isfinite(y) & (y > 0)]
    if not len(y):
        return 1.0
    return level / float(np.percentile(y, percentile))


def tone_curve(rgb: np.ndarray) -> np.ndarray:
    """Linear up to 0.7, then a shoulder that reaches 1 at infinity."""
    start = 0.7
    over = np.maximum(rgb - start, 0)
    return np.where(rgb <= start, np.maximum(rgb, 0), start + (1 - start) * (1 - np.exp(-over / (1 - start))))


def srgb_from_linear(v: np.ndarray) -> np.ndarray:
    v = np.clip(v, 0, 1)
    return np.where(v <= 0.0031308, 12.92 * v, 1.055 * np.maximum(v, 1e-9) ** (1 / 2.4) - 0.055)


def linear_from_srgb(v: np.ndarray) -> np.ndarray:
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def parse_exposure(text: str) -> float | None:
    """The factor given on a command line; none for `auto`."""
    return None if text == "auto" else float(text)


def write_png(path: Path | str, rgb: np.ndarray, exposure: float | None, lit: np.ndarray | None = None) -> float:
    """Writes linear `rgb` (H, W, 3) and returns the exposure used; by default it is chosen from the pixels `lit`."""
    from PIL import Image

    if exposure is None:
        exposure = auto_exposure(rgb[lit] if lit is not None and lit.any() else rgb.reshape(-1, 3))
    encoded = srgb_from_linear(tone_curve(np.nan_to_num(rgb) * exposure))
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray((encoded * 255 + 0.5).astype(np.uint8)).save(path)
    return exposure
