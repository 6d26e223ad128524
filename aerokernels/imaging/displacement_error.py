"""Error of a displacement due to the field's grid, measured with coarser grids, and of a blur.

The rays of the aperture's middle are traced through the field with every second and every fourth node
(medium/levels.py), and through the field itself with a tenth of the tolerance in double precision. Near a shock the
displacement has a pole that a grid smooths, and its error changes sign from pixel to pixel: each pixel takes the
greatest error within four cells around it. Within a cell of the pole itself the error is not reliable. Where coarser
grids agree by chance, the error is at least that of the terms that the interpolant omits (omitted_terms.py).
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ..medium import IndexField
from ..medium.level_maps import pixels_around, remaining_error
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
    other: np.ndarray,
    points: np.ndarray,
    weights: np.ndarray,
    landing: Callable[..., tuple[np.ndarray, np.ndarray]],
) -> np.ndarray:
    """Return the error of a blur [pixels], shape (rows, columns, 2); NaN on a mesh without coarser levels.

    It is the sum of the blur's change with another number of points of the aperture, of its change with rays of a tenth
    of the tolerance in double precision, and of the error extrapolated from such traces of the field's coarser versions
    by the order observed around each pixel. The last two are root mean squares over the aperture of the changes of its
    rays' distances from their mean, which no change of the blur exceeds (the triangle inequality): the change of the
    blur itself vanishes by chance where some distances grow and others shrink.

    Args:
        field: The refractive index.
        camera: The camera.
        blur: The blur [pixels].
        other: The blur with another number of points of the aperture.
        points: The points of the aperture in `blur` [m], shape (n, 2).
        weights: Shares of the light of these points, shape (n,).
        landing: As in `displacement_error`, for any point of the aperture.
    """
    levels = field.refinement
    if levels is None:
        return np.full(blur.shape, np.nan)
    fields = [one for one in (levels.fine, levels.coarse, levels.coarser) if one is not None]
    versions = [(field, False), *([] if levels.fine is field else [(field, True)]), *((one, True) for one in fields)]
    spreads = [Spread.of(blur.shape) for _ in versions]
    differences = [Spread.of(blur.shape) for _ in versions[1:]]
    for point, weight in zip(points, weights, strict=True):
        before = None
        for number, (one, tight) in enumerate(versions):
            moved, arrived = landing(one, point, tight=tight)
            moved, light = np.moveaxis(moved, 0, -1), float(weight) * arrived
            spreads[number].add(moved, light)
            if before is not None:
                differences[number - 1].add(moved - before[0], np.minimum(light, before[1]))
            before = moved, light
    sizes = [one.size for one in spreads]
    # Rays that arrive in one version only are in no difference, but in the blur.
    changes = [np.maximum(d.size, np.abs(b - a)) for d, (a, b) in zip(differences, pairwise(sizes), strict=True)]
    left = remaining_error(levels, changes[1 - len(fields) :], _around(field, camera, blur.shape))
    return np.asarray((by_points(other - blur) + by_points(changes[0]))[..., None] + left)


@dataclass(frozen=True, eq=False)
class Spread:
    """Root mean square distances of vectors from their mean, summed up one point of the aperture after another.

    Attributes:
        light: Sum of the weights, shape (rows, columns, 1).
        total: Weighted sum of the vectors, shape (rows, columns, 2).
        square: Weighted sum of the squares of their components, shape (rows, columns, 2).
    """

    light: np.ndarray
    total: np.ndarray
    square: np.ndarray

    @classmethod
    def of(cls, shape: tuple[int, ...]) -> "Spread":
        """Return the spread of no vectors yet, for pictures of shape (rows, columns, 2)."""
        return cls(np.zeros((*shape[:2], 1)), np.zeros(shape), np.zeros(shape))

    def add(self, vectors: np.ndarray, weight: np.ndarray) -> None:
        """Add vectors, shape (rows, columns, 2), of a weight, shape (rows, columns)."""
        share = weight[..., None]
        self.light[...] += share
        self.total[...] += share * vectors
        self.square[...] += share * vectors**2

    @property
    def size(self) -> np.ndarray:
        """Root mean square distance from the mean along x and y, shape (rows, columns, 2); 0 without light."""
        light = np.maximum(self.light, 1e-300)
        return np.sqrt(np.maximum(self.square / light - (self.total / light) ** 2, 0.0))


def _around(field: IndexField, camera: Camera, shape: tuple[int, ...]) -> int:
    """Return the width in pixels over which the greatest error is taken, at the middle of the field's box."""
    return pixels_around(field, middle_distance(field, camera) * camera.pixel_tangent, (shape[0], shape[1]))
