"""How well two pictures of one scene agree, one of them noisy."""

import numpy as np

from .display import LUMINANCE


def blurred(image: np.ndarray, radius: int = 1) -> np.ndarray:
    """The mean over (2 radius + 1)^2 pixels, edges repeated."""
    width = 2 * radius + 1
    padded = np.pad(image, ((radius, radius), (radius, radius), (0, 0)), mode="edge")
    h, w = image.shape[:2]
    return sum(padded[j : j + h, i : i + w] for j in range(width) for i in range(width)) / width**2


def agreement(test: np.ndarray, reference: np.ndarray, brightest: float) -> dict[str, float]:
    """Figures of luminance over pixels that show something; those within two of one brighter than `brightest` (lamps) are left out.

    bias: mean(test) / mean(reference) - 1. mean: mean of |difference| over max(reference, 5 % of the mean), after a blur of
    3 x 3. rmse: root mean square of the blurred difference over the mean.
    """
    a, b = blurred(test) @ LUMINANCE, blurred(reference) @ LUMINANCE
    bright = (np.maximum(test, reference) @ LUMINANCE > brightest).astype(float)
    seen = (b > 0) & (blurred(bright[..., None], 2)[..., 0] == 0)
    a, b = a[seen], b[seen]
    level = b.mean()
    return {
        "pixels": int(seen.sum()),
        "bias": float(a.mean() / level - 1),
        "mean": float((np.abs(a - b) / np.maximum(b, 0.05 * level)).mean()),
        "rmse": float(np.sqrt(((a - b) ** 2).mean()) / level),
    }
