"""Error of a displacement due to the field's grid, measured with coarser grids, and of a blur.

The rays of the aperture's middle are traced through the field with every second and every fourth node
(medium/levels.py). Near a shock the displacement has a pole that a grid smooths, and its error changes sign from pixel
to pixel: each pixel takes the greatest error within four cells around it. Within a cell of the pole itself the error is
not reliable. Where coarser grids agree by chance, the error is at least that of the terms that the interpolant omits
(omitted_terms.py).
"""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from ..medium import IndexField
from ..medium.levels import LOWEST_ORDER, ORDER
from .camera import Camera
from .omitted_terms import middle_distance, omitted_displacement, stride

# Cells of the field around a pixel over which the greatest error is taken.
CELLS_AROUND = 4.0
# Factor on the change with another number of points of the aperture, and on the omitted terms.
SAFETY = 1.5


def displacement_error(
    field: IndexField, camera: Camera, shape: tuple[int, int], landing: Callable[[IndexField], Any]
) -> np.ndarray:
    """Return the error of a displacement [pixels], shape (rows, columns); NaN on a mesh without coarser levels.

    Args:
        field: The refractive index.
        camera: The camera.
        shape: Rows and columns.
        landing: Function that traces a field: shifts [pixels], shape (2, rows, columns), and 1 where rays arrived.
    """
    levels = field.refinement
    if levels is None:
        return np.full(shape, np.nan)
    fields = [one for one in (levels.fine, levels.coarse, levels.coarser) if one is not None]
    moved = [landing(one) for one in fields]
    arrived = np.prod([one[1] for one in moved], axis=0) > 0.0
    changes = [np.hypot(*(after[0] - before[0])) for before, after in pairwise(moved)]
    by_levels = _left(field, camera, [np.where(arrived, one, 0.0) for one in changes], levels.share)
    return np.maximum(by_levels, _by_terms(field, camera, shape))


def _by_terms(field: IndexField, camera: Camera, shape: tuple[int, int]) -> np.ndarray:
    """Return the error of a displacement by the terms that the interpolant omits [pixels], shape (rows, columns)."""
    from scipy.ndimage import maximum_filter

    step = stride(shape)
    some = omitted_displacement(field, camera, shape)
    around = maximum_filter(some, size=2 * (_pixels_around(field, camera, shape) // (2 * step) + 1) + 1, mode="nearest")
    rows, columns = (np.minimum(np.arange(n) // step, m - 1) for n, m in zip(shape, some.shape, strict=True))
    return np.asarray(SAFETY * around[np.ix_(rows, columns)])


def by_points(change: np.ndarray) -> np.ndarray:
    """Return the error of a mean over points of the aperture [pixels], from its change with another number of them.

    In one pixel the change may vanish by chance: the greatest of its neighbours is taken.

    Args:
        change: Along x and y [pixels], shape (rows, columns, 2).
    """
    from scipy.ndimage import maximum_filter

    size = np.linalg.norm(change, axis=-1)
    around = maximum_filter(np.nan_to_num(size), size=3, mode="nearest")
    return np.where(np.isfinite(size), SAFETY * around, np.nan)


def blur_error(
    field: IndexField,
    camera: Camera,
    blur: np.ndarray,
    count: int,
    other: int,
    seen: Callable[..., np.ndarray],
) -> np.ndarray:
    """Return the error of a blur [pixels], shape (rows, columns, 2); NaN on a mesh without coarser levels.

    It is the sum of the blur's change with another number of points of the aperture, of its change with rays of a tenth
    of the tolerance in double precision, and of the error extrapolated from such traces of the field's coarser versions
    by the order observed around each pixel.

    Args:
        field: The refractive index.
        camera: The camera.
        blur: The blur [pixels].
        count: Number of points of the aperture in `blur`.
        other: Another number of points.
        seen: Function that returns the blur of a field with a number of points of the aperture; `tight` sets the
            tighter tolerance.
    """
    levels = field.refinement
    if levels is None:
        return np.full(blur.shape, np.nan)
    total = by_points(seen(field, other) - blur)[..., None]
    fine, *rest = (
        seen(one, count, tight=True) for one in (levels.fine, levels.coarse, levels.coarser) if one is not None
    )
    exact = fine if levels.fine is field else seen(field, count, tight=True)
    left = _left(field, camera, [np.abs(after - before) for before, after in pairwise([fine, *rest])], levels.share)
    return np.asarray(total + np.abs(exact - blur) + left)


def _left(field: IndexField, camera: Camera, changes: list[np.ndarray], share: float) -> np.ndarray:
    """Extrapolate the error from changes between versions of a field, the finest first, shapes (rows, columns, ...)."""
    from scipy.ndimage import maximum_filter

    around = _pixels_around(field, camera, changes[0].shape[:2])
    size = (around, around, *([1] * (changes[0].ndim - 2)))
    last, *before = (maximum_filter(np.nan_to_num(one), size=size, mode="nearest") for one in changes)
    if not before:
        return np.asarray(share * last)
    # The order observed around each pixel: far from a shock it is the spline's, near a shock there is none.
    ratio = before[0] / np.maximum(last, 1e-300)
    order = np.clip(np.log2(np.maximum(ratio, 1e-300)), LOWEST_ORDER, ORDER[field.interpolation])
    return np.asarray(last / (2.0**order - 1.0))


def _pixels_around(field: IndexField, camera: Camera, shape: tuple[int, int]) -> int:
    """Return the width in pixels of CELLS_AROUND cells on both sides of a pixel, at the middle of the field's box."""
    if not field.is_uniform:
        return 3
    width = float(np.max(field.spacing)) / (middle_distance(field, camera) * camera.pixel_tangent)
    return 2 * int(np.clip(np.ceil(CELLS_AROUND * width), 1, max(shape))) + 1
