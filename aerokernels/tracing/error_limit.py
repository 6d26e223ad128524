"""The OPD error allowed to a ray, and the support of a field: the part of its box that must be integrated.

The tolerance is the greatest error; in a weak field it is also limited to a share of the greatest line integral, or an
OPD of 0 would do. Outside the support, on a path of length L with a lever arm A (lines.py), the potential is
below share / L and its slope below share / (L A).
"""

import numpy as np

from ..derived import cached_on
from ..medium import IndexField
from ..medium.grid import UniformGrid
from .blocks import over_lines
from .lines import LeverArms
from .scheme import LEAPFROG_ANGLE

# The share of the field's greatest optical path difference that a ray may lose.
SHARE = 1e-3
# Lines along the last axis that are summed first, along each other axis; relative difference of sums in another order.
SOME, ROUNDING = 4, 1e-9


@cached_on("field", 4)
def error_limit(field: IndexField, tolerance: float) -> float:
    """The OPD error [m] allowed to a ray, at most the requested `tolerance` [m]."""
    if path_exceeds(field, tolerance / SHARE):
        return tolerance
    greatest = greatest_path(field)
    # Smaller numbers are no meaningful optical paths [m]: their products in single precision vanish.
    return tolerance if greatest <= 0.0 else min(tolerance, max(SHARE * greatest, 1e-24))


def path_exceeds(field: IndexField, size: float) -> bool:
    """Whether the greatest path is above a size [m]; all lines are summed only if neither a bound nor some decide."""
    grid = field.samples
    if not isinstance(grid, UniformGrid):
        return False
    low, high = grid.extremes
    longest = float((grid.spacing * grid.shape).max())
    if max(high, -low) * longest <= size:
        return False
    return _some_path(grid) > size * (1.0 + ROUNDING) or greatest_path(field) > size


@cached_on("field")
def greatest_path(field: IndexField) -> float:
    """The greatest optical path difference of a line along one of the grid's axes [m]; 0 where that is not known."""
    grid = field.samples
    if not isinstance(grid, UniformGrid):
        return 0.0
    sums = over_lines(grid.samples, np.add)
    return max(float(found.max()) * float(spacing) for found, spacing in zip(sums, grid.spacing, strict=True))


@cached_on("grid")
def _some_path(grid: UniformGrid) -> float:
    """The greatest path along some lines of the last axis [m]."""
    rows = grid.samples[tuple(slice(None, None, max(1, count // SOME)) for count in grid.shape[:-1])]
    return float(np.abs(rows).sum(axis=-1, dtype=np.float64).max()) * float(grid.spacing[-1])


# The share of the tolerance that may be lost by taking the air outside to be uniform.
SUPPORT_SHARE = 0.05
# Nodes to each side on whose splines a coefficient acts, and one to spare.
MARGIN_NODES = 3


@cached_on("field", 8)
def support_box(
    field: IndexField, tolerance: float, lever_arms: LeverArms | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the support of a cubic uniform grid along the local axes [m], each of shape (2,) or (3,).

    Ignoring the air outside changes a path by less than SUPPORT_SHARE of the tolerance [m], and its deflection by no
    more than that. An empty support is the middle of the box. Without `lever_arms` lines end on a surface across them.
    """
    grid = field.samples
    assert isinstance(grid, UniformGrid)
    potential, slope = left_out(field, tolerance, lever_arms)
    low, high = np.array(grid.low, dtype=float), np.array(grid.high, dtype=float)
    for axis, peaks in enumerate(potential_peaks(grid)):
        supported = peaks > potential
        if np.isfinite(slope):
            supported |= _slope_peaks(grid)[axis] > slope
        found = np.flatnonzero(supported)
        if not len(found):
            low = high = 0.5 * (low + high)
            break
        # Coefficient k is that of node k - 1.
        ends = grid.low[axis] + grid.spacing[axis] * (found[[0, -1]] - 1 + np.array([-MARGIN_NODES, MARGIN_NODES]))
        low[axis], high[axis] = max(low[axis], ends[0]), min(high[axis], ends[1])
    for corner in (low, high):
        corner.setflags(write=False)
    return low, high


def left_out(field: IndexField, tolerance: float, lever_arms: LeverArms | None) -> tuple[float, float]:
    """The greatest potential [1] and slope of it [1/m] that may be ignored; infinite where slopes do not count."""
    grid = field.samples
    assert isinstance(grid, UniformGrid)
    extent = np.asarray(grid.high) - np.asarray(grid.low)
    # A chord of the box of revolution is longer than its half-plane.
    longest = float(np.linalg.norm(extent * ([2.0, 1.0] if field.geometry == "axisymmetric" else 1.0)))
    if lever_arms is None:
        return SUPPORT_SHARE * tolerance / longest, np.inf
    path_length = max(lever_arms.path_length, longest)
    potential = SUPPORT_SHARE * tolerance / path_length
    # A ray's own deflection is an obliquity too, of second order in the contrast: it counts only on far flights.
    beyond = max(lever_arms.reach - 2.0 * path_length, 0.0)
    # The slope of a spline is below twice its greatest coefficient over the spacing.
    if lever_arms.lever_arm + beyond * LEAPFROG_ANGLE <= 0.5 * float(np.min(grid.spacing)):
        return potential, np.inf
    deflection = min(LEAPFROG_ANGLE, path_length * max(float(peaks.max(initial=0.0)) for peaks in _slope_peaks(grid)))
    lever_arm = lever_arms.lever_arm + beyond * deflection
    return potential, SUPPORT_SHARE * tolerance / (path_length * lever_arm) if lever_arm > 0.0 else np.inf


@cached_on("grid")
def potential_peaks(grid: UniformGrid) -> list[np.ndarray]:
    """Along each axis, the greatest absolute coefficient in each plane across it."""
    return _peaks_along_axes(grid.coefficients)


@cached_on("grid")
def _slope_peaks(grid: UniformGrid) -> list[np.ndarray]:
    """Along each axis, the greatest absolute difference of neighbouring coefficients over the spacing [1/m]."""
    coefficients = np.asarray(grid.coefficients, np.float64)
    peaks = [np.zeros(count) for count in coefficients.shape]
    for axis, spacing in enumerate(grid.spacing):
        for other, found in enumerate(_peaks_along_axes(np.diff(coefficients, axis=axis) / spacing)):
            for shift in (0, 1) if other == axis else (0,):  # a difference belongs to both of its coefficients
                part = peaks[other][shift : shift + len(found)]
                np.maximum(part, found, out=part)
    return peaks


def _peaks_along_axes(values: np.ndarray) -> list[np.ndarray]:
    """Along each axis, the greatest absolute value in each plane across it."""
    over_first, *others = over_lines(values, np.maximum)
    peaks = [others[-1].max(axis=tuple(range(1, values.ndim - 1)))]
    for axis in range(1, values.ndim):
        peaks.append(over_first.max(axis=tuple(other - 1 for other in range(1, values.ndim) if other != axis)))
    return peaks
