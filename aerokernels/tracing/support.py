"""The support of a field: the part of its box outside which the air is so uniform that it need not be integrated.

Ignoring the air outside may cost a share of the tolerance, by its optical path and by its deflection of rays. On a path
of length L through the box the potential s outside is below share / L. Where errors of direction count with a lever arm
A (lever_arms.py), its slope is below share / (L A).
"""

import numpy as np

from ..derived import cached_on
from ..medium import IndexField
from ..medium.grid import UniformGrid
from .blocks import over_lines
from .lever_arms import LeverArms
from .scheme import LEAPFROG_ANGLE

# The share of the tolerance that may be lost by taking the air outside to be uniform.
SUPPORT_SHARE = 0.05
# Nodes to each side on whose splines a coefficient acts, and one to spare.
MARGIN_NODES = 3
# Boxes cached on a field.
CACHED = 8  # speed only


@cached_on("field", CACHED)
def support_box(
    field: IndexField, tolerance: float, lever_arms: LeverArms | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the support along the local axes [m], each of shape (2,) or (3,).

    Outside, the optical potential is so small that ignoring it changes the path along any line through the box by less
    than SUPPORT_SHARE of the tolerance [m], and by no more than that for its deflection. Where the support is empty,
    both corners are the middle of the box.

    Args:
        field: The refractive index, on a cubic uniform grid.
        tolerance: OPD error allowed for a ray [m].
        lever_arms: How far the rays fly and at what angle they meet their stop; None takes a line across the box that
            ends on a surface across it.
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
    return peaks_along_axes(grid.coefficients)


@cached_on("grid")
def _slope_peaks(grid: UniformGrid) -> list[np.ndarray]:
    """Along each axis, the greatest absolute difference of neighbouring coefficients over the spacing [1/m]."""
    peaks = [np.zeros(count) for count in grid.coefficients.shape]
    for axis, spacing in enumerate(grid.spacing):
        change = np.diff(grid.coefficients, axis=axis) / spacing
        for other, found in enumerate(peaks_along_axes(change)):
            # A difference belongs to both of its coefficients.
            if other == axis:
                np.maximum(peaks[axis][:-1], found, out=peaks[axis][:-1])
                np.maximum(peaks[axis][1:], found, out=peaks[axis][1:])
            else:
                np.maximum(peaks[other], found, out=peaks[other])
    return peaks


def peaks_along_axes(values: np.ndarray) -> list[np.ndarray]:
    """Along each axis, the greatest absolute value in each plane across it."""
    over_first, *others = over_lines(values, np.maximum)
    peaks = [others[-1].max(axis=tuple(range(1, values.ndim - 1)))]
    for axis in range(1, values.ndim):
        peaks.append(over_first.max(axis=tuple(other - 1 for other in range(1, values.ndim) if other != axis)))
    return peaks
