"""The empty cube from closed forms alone: form factors between rectangles and a dense solve, without the baker.

View factors between parallel and perpendicular rectangles: Ehlert, Smith, "View Factors for Perpendicular and Parallel
Rectangular Plates" (Journal of Thermophysics and Heat Transfer 7, 1993), also C-13 and C-15 in Howell's catalogue.
"""

from itertools import product

import numpy as np

SIDES = ["floor", "ceiling", "left", "right", "back", "front"]


def parallel(x: np.ndarray, y: np.ndarray, distance: float) -> np.ndarray:
    """Antiderivative for two rectangles that face each other; x, y: offsets of their edges."""
    p, q = np.hypot(x, distance), np.hypot(y, distance)
    return (y * p * np.arctan(y / p) + x * q * np.arctan(x / q) - distance**2 / 2 * np.log(x * x + y * y + distance**2)) / (2 * np.pi)


def perpendicular(along: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The same for two at a right angle; a, b: distances of their edges from the common line, along: offset on it."""
    s = a * a + b * b
    r = np.sqrt(s)
    turned = np.where(s > 0, along * r * np.arctan(along / np.where(s > 0, r, 1)), 0)
    total = s + along * along
    both = np.where(total > 0, (s - along * along) * np.log(np.where(total > 0, total, 1)), 0)
    return (turned - both / 4) / (2 * np.pi)


def factors(n: int) -> np.ndarray:
    """F (6 n^2, 6 n^2) of the unit cube, each side cut into n x n: sides in the order of `SIDES`, on each the patches by the two
    axes that it spans, in the axes' order."""
    edges = np.arange(n + 1) / n
    # Each side: the axis of its normal, and where it lies on it.
    place = [(1, 0), (1, 1), (0, 0), (0, 1), (2, 0), (2, 1)]
    offset = edges[:, None] - edges[None]
    out = np.zeros((6, n, n, 6, n, n))
    for (i, (axis, at)), (j, (other, there)) in product(enumerate(place), repeat=2):
        if axis == other and at != there:
            # Over edges (first of i, first of j, second of i, second of j).
            block = summed(parallel(offset[:, :, None, None], offset[None, None], 1.0)).transpose(0, 2, 1, 3)
        elif axis != other:
            # Over edges (common of i, common of j, the other axis of i, the other axis of j).
            away, its = np.abs(edges - there), np.abs(edges - at)
            block = summed(perpendicular(offset[:, :, None, None], away[:, None], its[None, :]))
            block *= (1 - 2 * there) * (1 - 2 * at)
            common = 3 - axis - other
            mine = (0, 2) if common < other else (2, 0)
            yours = (1, 3) if common < axis else (3, 1)
            block = block.transpose(*mine, *yours)
        else:
            continue
        out[i, :, :, j] = block * n * n
    return out.reshape(6 * n * n, 6 * n * n)


def summed(corners: np.ndarray) -> np.ndarray:
    """The alternating sum over both edges of each of four axes."""
    for k in range(4):
        corners = np.diff(corners, axis=k)
    return corners


def cube(n: int, albedo: dict[str, np.ndarray], emission: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """E / pi [nit] on each side's patches (n, n, 3), from `B = M + rho F B` solved directly, a channel at a time; albedo and emitted
    radiance [nit] by side."""
    f = factors(n)
    rho = np.repeat([albedo[s] for s in SIDES], n * n, axis=0).astype(float)
    emitted = np.repeat([emission.get(s, np.zeros(3)) for s in SIDES], n * n, axis=0).astype(float)
    received = np.empty_like(rho)
    for c in range(3):
        radiance = np.linalg.solve(np.eye(len(f)) - rho[:, c, None] * f, emitted[:, c])
        received[:, c] = f @ radiance
    return dict(zip(SIDES, received.reshape(6, n, n, 3)))
