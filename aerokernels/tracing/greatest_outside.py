"""Find on a device the greatest of a grid's values outside a part of the grid, for one field at a time.

So the device that computes a grid's spline also examines whether a known support contains that of other values, and
whether the air is undisturbed at the faces of the box that rays cross.
"""

import math
from typing import Any

import numpy as np

from ..medium import IndexField
from ..medium.grid import UniformGrid
from .engines import Engine
from .engines.kernel_table import SUPPORT_KERNELS
from .error_budget.known_air import OUTERMOST
from .lines import SIDE
from .support import MARGIN_NODES

# The first and the last node of a part along each axis.
Part = list[tuple[int, int]]


class GreatestOutside:
    """The launches that find the greatest size outside a part.

    Attributes:
        is_whole: Whether nothing is outside.
    """

    def __init__(self, engine: Engine, shape: tuple[int, ...], part: Part):
        """Allocate the memory for grids of a shape."""
        self.engine, self.counts = engine, (1, *shape)[-3:]
        self.is_whole = all((low, high) == (0, count - 1) for (low, high), count in zip(part, shape, strict=True))
        if self.is_whole:
            return
        _, second, third = self.counts
        self.part = [node for nodes in ([(0, 0)] * (3 - len(shape)) + part) for node in nodes]
        self.kernels = engine.kernels(SUPPORT_KERNELS)
        self.spare = engine.empty(second * third)
        self.reading = engine.fetched([np.empty(third)])

    def start(self, values: Any) -> None:
        """Start the launches for the values in a buffer."""
        if self.is_whole:
            return
        (first, second, third), launch, kernels = self.counts, self.engine.launch, self.kernels
        before = [values, first, second, third, *self.part]
        launch(kernels["greatest_outside"], before, [self.spare], second * third)
        launch(kernels["block_maxima"], [self.spare, second, third, second], [*self.reading.buffers], third)
        self.reading.start()

    def greatest(self) -> float:
        """Wait, and return the greatest size; minus infinity if nothing is outside."""
        return -math.inf if self.is_whole else float(self.reading.wait()[0].max())


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


def part_behind_faces(field: IndexField, faces: np.ndarray) -> Part:
    """The part of a field's samples outside which are those that face_strengths takes for some faces, by number."""
    shape = field.samples.shape
    # The side of a cylinder is the last face of the first axis that samples have.
    numbers = {1 if face == SIDE else int(face) - 2 * (3 - len(shape)) for face in faces}
    return [
        (OUTERMOST * (2 * axis in numbers), count - 1 - OUTERMOST * (2 * axis + 1 in numbers))
        for axis, count in enumerate(shape)
    ]
