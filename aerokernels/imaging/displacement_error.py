"""What a displacement may be off by: the field's own grid, judged by coarser ones, and the tolerance of the rays.

The rays of the aperture's middle are traced through the field with every second and every fourth node
(medium/levels.py). Near a shock the displacement has a pole that a grid smooths, and its error changes sign from pixel
to pixel: each pixel takes the greatest within four cells around it. Within a cell of the pole itself nothing is told.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from ..medium import IndexField
from ..medium.levels import LOWEST_ORDER, ORDER, refinement
from ..tracing.lines import box_size
from .camera import Camera

# Cells of the field about a pixel over which the greatest error counts.
CELLS_AROUND = 4.0


def displacement_error(
    field: IndexField, camera: Camera, shape: tuple[int, int], landing: Callable[[IndexField], Any]
) -> np.ndarray:
    """The error of a displacement [pixels], shape (rows, columns); NaN on a mesh that can't be judged.

    Args:
        field: The refractive index.
        camera: The camera.
        shape: Rows and columns.
        landing: Traces a field: shifts [pixels], shape (2, rows, columns), and 1 where rays arrived.
    """
    from scipy.ndimage import maximum_filter

    levels = refinement(field)
    if levels is None:
        return np.full(shape, np.nan)
    fields = [one for one in (levels.fine, levels.coarse, levels.coarser) if one is not None]
    moved = [landing(one) for one in fields]
    arrived = np.prod([one[1] for one in moved], axis=0) > 0.0
    changes = [np.hypot(*(after[0] - before[0])) for before, after in pairwise(moved)]
    around = _pixels_around(field, camera, shape)
    last, *before = (maximum_filter(np.where(arrived, one, 0.0), size=around, mode="nearest") for one in changes)
    if not before:
        return np.asarray(levels.share * last)
    # The order seen about each pixel, where the error is: far from a shock it is the spline's, near it there is none.
    ratio = before[0] / np.maximum(last, 1e-300)
    order = np.clip(np.log2(np.maximum(ratio, 1e-300)), LOWEST_ORDER, ORDER[field.interpolation])
    return np.asarray(last / (2.0**order - 1.0))


def _pixels_around(field: IndexField, camera: Camera, shape: tuple[int, int]) -> int:
    """Width in pixels of CELLS_AROUND on both sides of one, at the middle of the field's box."""
    if not field.is_uniform:
        return 3
    low, high = (np.where(np.isfinite(corner), corner, camera.pupil.center) for corner in field.box)
    away = max(float((0.5 * (low + high) - camera.pupil.center) @ camera.pupil.normal), box_size(field))
    width = float(np.max(field.spacing)) / (away * camera.pixel_tangent)
    return 2 * int(np.clip(np.ceil(CELLS_AROUND * width), 1, max(shape))) + 1
