"""Check contrasts that a caller gives for an index field: at samples, and at walls."""

from typing import Any

import numpy as np

from aerokernels.inputs.checks import warn_caller

from ..device_arrays import plain_array
from ..inputs.kinds import are_numbers
from .grid import check_finite


def contrast_array(contrast: Any) -> np.ndarray:
    """Return a contrast as a NumPy array of real numbers.

    Raises:
        TypeError: Other entries.
        ValueError: float16, whose least digit is 6e-8: a contrast of air would have three or four digits.
    """
    array = plain_array(contrast)
    if not np.issubdtype(array.dtype, np.number) or np.iscomplexobj(array):
        raise TypeError(f"contrast must be an array of real numbers, got dtype {array.dtype}")
    if array.dtype == np.float16:
        raise ValueError("contrast is float16, whose least digit is 6e-8: compute n - ambient_index in float32 or more")
    return array


def warn_of_index(least: float, greatest: float) -> None:
    """Warn a caller of from_samples or from_mesh whose contrasts look like indices n, of any medium up to germanium."""
    if 0.99 < least <= greatest < 4.5:
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
