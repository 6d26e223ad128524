"""The OPD error that rays are held to: the tolerance asked for, or less in a field whose own OPD is hardly greater.

The tolerance is the greatest OPD error allowed. In a field whose greatest OPD is no larger than the tolerance, an OPD
of 0 would be within it, and the field would be ignored. The error is therefore also limited to a share of the greatest
line integral of the field, however weak it is, and the result is right to that share.
"""

import numpy as np

from ..medium import IndexField
from ..medium.grid import UniformGrid
from .blocks import over_lines

# The share of the field's greatest optical path difference that a ray may lose.
SHARE = 1e-3
# Numbers below this are no optical paths [m]: their products in single precision vanish.
LEAST = 1e-24


def held_error(field: IndexField, tolerance: float) -> float:
    """The OPD error [m] that a ray is held to, at most `tolerance` [m], the one asked for."""
    greatest = greatest_path(field)
    return tolerance if greatest <= 0.0 else min(tolerance, max(SHARE * greatest, LEAST))


def greatest_path(field: IndexField) -> float:
    """The greatest optical path difference of a line along one of the grid's axes [m]; 0 where that is not known."""
    grid = field.samples
    if not isinstance(grid, UniformGrid):
        return 0.0
    greatest: float = field.derive("greatest path", lambda: _find_greatest_path(grid))
    return greatest


def _find_greatest_path(grid: UniformGrid) -> float:
    sums = over_lines(grid.samples, np.add)
    return max(float(found.max()) * float(spacing) for found, spacing in zip(sums, grid.spacing, strict=True))
