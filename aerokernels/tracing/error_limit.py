"""The OPD error allowed to a ray: the requested tolerance, or less in a field whose own OPD is hardly greater.

The tolerance is the greatest OPD error allowed. In a field whose greatest OPD is no larger than the tolerance, an OPD
of 0 would be within it, and the field would be ignored. The error is therefore also limited to a share of the greatest
line integral of the field, however weak it is, and the result is accurate to that share.
"""

import numpy as np

from ..derived import cached_on
from ..medium import IndexField
from ..medium.grid import UniformGrid
from .blocks import over_lines

# The share of the field's greatest optical path difference that a ray may lose.
SHARE = 1e-3
# Smaller numbers are no meaningful optical paths [m]: their products in single precision vanish.
LEAST = 1e-24
# Lines along the last axis that are summed first, along each other axis; relative difference of sums in another order.
SOME, ROUNDING = 4, 1e-9
# Tolerances whose limits a field caches.
CACHED = 4  # speed only


@cached_on("field", CACHED)
def error_limit(field: IndexField, tolerance: float) -> float:
    """The OPD error [m] allowed to a ray, at most the requested `tolerance` [m]."""
    if path_exceeds(field, tolerance / SHARE):
        return tolerance
    greatest = greatest_path(field)
    return tolerance if greatest <= 0.0 else min(tolerance, max(SHARE * greatest, LEAST))


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


def greatest_path(field: IndexField) -> float:
    """The greatest optical path difference of a line along one of the grid's axes [m]; 0 where that is not known."""
    grid = field.samples
    if not isinstance(grid, UniformGrid):
        return 0.0
    return _greatest_path(grid)


@cached_on("grid")
def _some_path(grid: UniformGrid) -> float:
    """The greatest path along some lines of the last axis [m]."""
    rows = grid.samples[tuple(slice(None, None, max(1, count // SOME)) for count in grid.shape[:-1])]
    return float(np.abs(rows).sum(axis=-1).max()) * float(grid.spacing[-1])


@cached_on("grid")
def _greatest_path(grid: UniformGrid) -> float:
    sums = over_lines(grid.samples, np.add)
    return max(float(found.max()) * float(spacing) for found, spacing in zip(sums, grid.spacing, strict=True))
