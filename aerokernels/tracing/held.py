"""The OPD error that rays are held to: the tolerance asked for, or less where the whole field is worth hardly more.

A tolerance says how much of an optical path difference may be lost. A field whose greatest one is of that size or below
would be passed over as a whole, and its rays be "right" with an OPD of 0. So a ray may lose no more than a share of the
greatest line integral that the field itself has, however weak it is: the answer is then right to that share.
"""

import numpy as np

from ..medium import IndexField
from ..medium.grid import UniformGrid

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
    size = np.abs(grid.samples)
    return max(float(size.sum(axis=axis).max()) * float(spacing) for axis, spacing in enumerate(grid.spacing))
