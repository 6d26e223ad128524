"""Errors of a map's numbers due to its pixels, each of which has one ray.

Every other pixel along both axes makes a map of pixels twice as wide, with their own shares of the pupil; there are
four such maps. The number of one of them differs from the whole map's by sqrt(3) standard errors of the latter where
the wavefront varies from pixel to pixel, and by three times its error where that is of second order in the pixel. The
error is FACTOR times the root mean square of the four differences over sqrt(3).
"""

from collections.abc import Callable
from typing import Any

import numpy as np

FACTOR = 2.0
# Least number of pixels of each of the four maps.
LEAST = 3


def half_density(x: np.ndarray, y: np.ndarray, pixel: float, coverage: Callable[..., np.ndarray]) -> list[np.ndarray]:
    """Return the weights of the four maps of every other pixel, zero elsewhere, each of shape (ny, nx).

    Args:
        x: Pixel centres along the first axis [m], shape (nx,).
        y: Pixel centres along the second axis [m], shape (ny,).
        pixel: Side of a pixel [m].
        coverage: Returns the shares of cells, between edges along both axes, that are in the pupil.
    """
    found = []
    for row in range(min(2, len(y))):
        for column in range(min(2, len(x))):
            edges = [np.append(axis - pixel, axis[-1] + pixel) for axis in (x[column::2], y[row::2])]
            weight = np.zeros((len(y), len(x)))
            weight[row::2, column::2] = coverage(*edges)
            found.append(weight)
    return found


def pixel_errors(whole: np.ndarray, parts: Any) -> np.ndarray:
    """Return the errors of numbers, shape (n,), from those of the four maps, shape (4, n)."""
    return np.asarray(FACTOR * np.sqrt(np.mean((np.asarray(parts) - whole) ** 2, axis=0) / 3.0))
