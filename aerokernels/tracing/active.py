"""The part of a field's box in which there is anything to integrate: around it the air is as uniform as matters."""

import weakref

import numpy as np

from ..medium import IndexField
from ..medium.grid import UniformGrid

# The share of the tolerance that may be lost by taking the air outside for uniform.
QUIET_SHARE = 0.05
# Nodes to each side whose spline a coefficient is part of, and one to spare.
MARGIN_NODES = 3

_peaks: weakref.WeakKeyDictionary = weakref.WeakKeyDictionary()


def active_box(field: IndexField, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Corners of it along the local axes [m], each of shape (2,) or (3,); of a cubic uniform grid.

    Outside, the optical potential is so small that the path along any line through the box is off by less than
    QUIET_SHARE of the tolerance [m]. Without any such part both corners are the box's middle.
    """
    grid = field.samples
    assert isinstance(grid, UniformGrid)
    if grid not in _peaks:
        size = np.abs(grid.coefficients)
        axes = range(size.ndim)
        _peaks[grid] = [size.max(axis=tuple(other for other in axes if other != axis)) for axis in axes]
    extent = np.asarray(grid.high) - np.asarray(grid.low)
    # A chord of the box of revolution is longer than its half-plane.
    longest = float(np.linalg.norm(extent * ([2.0, 1.0] if field.geometry == "axisymmetric" else 1.0)))
    threshold = QUIET_SHARE * tolerance / longest
    low, high = np.array(grid.low, dtype=float), np.array(grid.high, dtype=float)
    for axis, peaks in enumerate(_peaks[grid]):
        found = np.flatnonzero(peaks > threshold)
        if not len(found):
            middle = 0.5 * (low + high)
            return middle, middle
        # Coefficient k is that of node k - 1.
        ends = grid.low[axis] + grid.spacing[axis] * (found[[0, -1]] - 1 + np.array([-MARGIN_NODES, MARGIN_NODES]))
        low[axis], high[axis] = max(low[axis], ends[0]), min(high[axis], ends[1])
    return low, high
