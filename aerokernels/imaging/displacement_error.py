"""Error of a displacement due to the field's grid, measured with coarser grids, and of a blur.

The rays of the aperture's middle are traced through the field with every second and every fourth node
(medium/levels.py), and through the field itself with a tenth of the tolerance in double precision. Near a shock the
displacement has a pole that a grid smooths, and its error changes sign from pixel to pixel: each pixel takes the
greatest error within four cells around it. Within a cell of the pole itself the error is not reliable. Where coarser
grids agree by chance, the error is at least that of the terms that the interpolant omits (omitted_terms.py).
"""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from ..medium import IndexField
from ..medium.level_maps import changes_between, pixels_around, remaining_error
from .camera import Camera
from .omitted_terms import middle_distance, omitted_displacement, stride

# Factor on the change with another number of points of the aperture, and on the omitted terms.
SAFETY = 1.5


def displacement_error(
    field: IndexField, camera: Camera, shape: tuple[int, int], landing: Callable[..., Any]
) -> np.ndarray:
    """Return the error of a displacement [pixels], shape (rows, columns); NaN on a mesh without coarser levels.

    It is the sum of the grid's error and of that of the rays' tolerance and precision.

    Args:
        field: The refractive index.
        camera: The camera.
        shape: Rows and columns.
        landing: Function that traces a field: shifts [pixels], shape (2, rows, columns), and 1 where rays arrived;
            `tight` sets a tighter tolerance.
    """
    levels = field.refinement
    if levels is None:
        return np.full(shape, np.nan)
    fields = [one for one in (levels.fine, levels.coarse, levels.coarser) if one is not None]
    moved = [landing(one) for one in fields]
    arrived = np.prod([one[1] for one in moved], axis=0) > 0.0
    changes = [np.hypot(*(after[0] - before[0])) for before, after in pairwise(moved)]
    around = _around(field, camera, shape)
    by_levels = remaining_error(levels, [np.where(arrived, one, 0.0) for one in changes], around)
    tight, run = landing(field, tight=True), moved[0] if levels.fine is field else landing(field)
    change = np.where((tight[1] * run[1])[..., None] > 0, np.moveaxis(run[0] - tight[0], 0, -1), 0.0)
    return np.maximum(by_levels, _by_terms(field, camera, shape)) + by_points(change)


def _by_terms(field: IndexField, camera: Camera, shape: tuple[int, int]) -> np.ndarray:
    """Return the error of a displacement by the terms that the interpolant omits [pixels], shape (rows, columns)."""
    from scipy.ndimage import maximum_filter

    step = stride(shape)
    some = omitted_displacement(field, camera, shape)
    around = maximum_filter(some, size=2 * (_around(field, camera, shape) // (2 * step) + 1) + 1, mode="nearest")
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
    left = remaining_error(levels, changes_between([fine, *rest]), _around(field, camera, blur.shape))
    return np.asarray(total + np.abs(exact - blur) + left)


def _around(field: IndexField, camera: Camera, shape: tuple[int, ...]) -> int:
    """Return the width in pixels over which the greatest error is taken, at the middle of the field's box."""
    return pixels_around(field, middle_distance(field, camera) * camera.pixel_tangent, (shape[0], shape[1]))
