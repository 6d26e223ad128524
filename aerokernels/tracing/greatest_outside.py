"""Find on a device the greatest of a grid's values outside a part of the grid, for one field at a time.

So the device that computes a grid's spline also examines whether a known support contains that of other values.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..medium.grid import UniformGrid
from .engines import Engine
from .error_limit import MARGIN_NODES

# The first and the last node of a part along each axis.
Part = list[tuple[int, int]]


class GreatestOutside:
    """The launch that finds the greatest size outside a part.

    Attributes:
        is_whole: Whether nothing is outside.
        arrays: The host arrays that receive the results, see Engine.fetched.
    """

    def __init__(self, engine: Engine, shape: tuple[int, ...], part: Part):
        """Make the launch for grids of a shape."""
        self.engine, self.counts = engine, (1, *shape)[-3:]
        self.is_whole = all((low, high) == (0, count - 1) for (low, high), count in zip(part, shape, strict=True))
        self.part = [node for nodes in ([(0, 0)] * (3 - len(shape)) + part) for node in nodes]
        self.kernel = engine.kernels(["greatest_outside"])["greatest_outside"]
        _, second, third = self.counts
        self.arrays = [] if self.is_whole else [np.empty(second * third)]

    def start(self, values: Any, made: Sequence[Any]) -> None:
        """Start the launch for the values in a buffer, into buffers for the arrays."""
        for buffer, found in zip(made, self.arrays, strict=True):
            self.engine.launch(self.kernel, [values, *self.counts, *self.part], [buffer], len(found))

    @staticmethod
    def greatest(arrays: Sequence[np.ndarray]) -> float:
        """The greatest size, from the arrays with the results; minus infinity if nothing is outside."""
        return max((float(found.max()) for found in arrays), default=-math.inf)


def part_of_support(grid: UniformGrid, box: tuple[np.ndarray, np.ndarray]) -> Part:
    """The part of a grid's coefficients outside which all are negligible where a support is in a box [m]."""
    part = []
    for axis, count in enumerate(grid.coefficient_shape):
        # Where find_support_box would put the faces of a support that begins, or ends, at each coefficient.
        places = grid.low[axis] + grid.spacing[axis] * (np.arange(count) - 1.0)
        margin = MARGIN_NODES * grid.spacing[axis]
        low = np.maximum(places - margin, grid.low[axis]) >= box[0][axis]
        high = np.minimum(places + margin, grid.high[axis]) <= box[1][axis]
        inside = np.flatnonzero(low & high)
        part.append((int(inside[0]), int(inside[-1])) if len(inside) else (count, -1))
    return part
