"""Check contrasts that a caller gives for an index field: at samples, and at walls."""

from typing import Any

import numpy as np

from ..inputs.arguments import are_numbers
from ..inputs.warned import warn_caller
from .grid import check_finite


def warn_of_index(least: float, greatest: float) -> None:
    """Warn a caller of from_samples or from_mesh whose contrasts look like indices n."""
    if 0.99 < least <= greatest < 1.5:
        warn_caller(
            f"contrast is {least:g} to {greatest:g} everywhere: it is n - ambient_index, not n itself",
        )


def checked_walls(walls: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return positions at walls [m], shape (n, 2), and the contrast there, shape (n,), as float64 arrays.

    Raises:
        TypeError: Not a pair of arrays of numbers.
        ValueError: Other shapes, or entries that are not finite.
    """
    if not isinstance(walls, (tuple, list)) or len(walls) != 2 or not all(are_numbers(each) for each in walls):
        raise TypeError(f"walls must be a pair of arrays, points [m] and contrasts, got {type(walls).__name__}")
    points, contrast = (np.asarray(each, dtype=np.float64) for each in walls)
    if contrast.ndim != 1 or points.shape != (len(contrast), 2):
        raise ValueError(f"walls need points of shape (n, 2) and n contrasts, got {points.shape} and {contrast.shape}")
    check_finite(points, "the points at walls")
    check_finite(contrast, "the contrast at walls")
    return points, contrast
