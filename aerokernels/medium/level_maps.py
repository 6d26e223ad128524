"""Extrapolate the error of a map, such as a picture, from the maps of a field's coarser versions (levels.py).

Near a shock a deflection has a pole that a grid smooths, and its error changes sign from pixel to pixel; elsewhere
coarser grids may agree by chance. So each pixel takes the greatest change within some cells around it.
"""

from itertools import pairwise
from typing import Any

import numpy as np

from .levels import LOWEST_ORDER, ORDER, RefinementLevels

# Cells of the field around a pixel over which the greatest change is taken.
CELLS_AROUND = 4.0
# Factor on the extrapolated error, which coarser grids tell roughly.
SAFETY = 1.5
# Pixels around a pixel for a field that is not on a uniform grid.
PIXELS_AROUND = 1


def pixels_around(field: Any, pixel: float, shape: tuple[int, int]) -> int:
    """Return the width in pixels of CELLS_AROUND cells on both sides of a pixel, an odd number.

    Args:
        field: The refractive index.
        pixel: Side of a pixel at the field [m].
        shape: Rows and columns of the map.
    """
    if not field.is_uniform:
        return 2 * PIXELS_AROUND + 1
    width = CELLS_AROUND * float(np.max(field.spacing)) / pixel
    return 2 * int(np.clip(np.ceil(width), 1, max(shape))) + 1


def remaining_error(levels: RefinementLevels, changes: list[np.ndarray], around: int) -> np.ndarray:
    """Return the error of a map, of its shape, by the order observed around each pixel.

    Args:
        levels: The field's coarser versions.
        changes: Absolute changes from `fine` to `coarse` and, if there is one, to `coarser`, each of shape (rows,
            columns, ...); NaN counts as no change.
        around: Width in pixels over which the greatest change is taken.
    """
    from scipy.ndimage import maximum_filter

    size = (around, around, *([1] * (changes[0].ndim - 2)))
    last, *before = (maximum_filter(np.nan_to_num(one), size=size, mode="nearest") for one in changes)
    if not before:
        return np.asarray(SAFETY * levels.share * last)
    # Far from a shock the order is the spline's, near a shock there is none.
    ratio = before[0] / np.maximum(last, 1e-300)
    order = np.clip(np.log2(np.maximum(ratio, 1e-300)), LOWEST_ORDER, ORDER[levels.fine.interpolation])
    return np.asarray(SAFETY * last / (2.0**order - 1.0))


def changes_between(maps: list[np.ndarray]) -> list[np.ndarray]:
    """Return the absolute changes from each map to the next one."""
    return [np.abs(after - before) for before, after in pairwise(maps)]
