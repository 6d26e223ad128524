"""Examine on the device that computes a grid's spline whether a known support contains that of other values."""

from typing import Any

import numpy as np

from ..medium import IndexField
from ..medium.grid import UniformGrid
from .engines import Engine
from .engines.kernel_table import SUPPORT_KERNELS
from .support import MARGIN_NODES


class SupportOnDevice:
    """The launches that find the greatest coefficient outside a support, for one field at a time."""

    def __init__(self, engine: Engine, field: IndexField, box: tuple[np.ndarray, np.ndarray]):
        """Allocate the memory for fields on the nodes of this one; `box` are the corners of the support [m]."""
        grid = field.samples
        assert isinstance(grid, UniformGrid)
        self.engine, shape = engine, grid.coefficient_shape
        part: list[int] = [0, 0] * (3 - len(shape))
        for axis, count in enumerate(shape):
            # Where find_support_box would put the faces of a support that begins, or ends, at each coefficient.
            places = grid.low[axis] + grid.spacing[axis] * (np.arange(count) - 1.0)
            margin = MARGIN_NODES * grid.spacing[axis]
            low = np.maximum(places - margin, grid.low[axis]) >= box[0][axis]
            high = np.minimum(places + margin, grid.high[axis]) <= box[1][axis]
            inside = np.flatnonzero(low & high)
            part += [int(inside[0]), int(inside[-1])] if len(inside) else [count, -1]
        self.counts = (1, *shape)[-3:]
        first, second, third = self.counts
        self.part, self.is_whole = part, part == [0, first - 1, 0, second - 1, 0, third - 1]
        if not self.is_whole:
            self.kernels = engine.kernels(SUPPORT_KERNELS)
            self.spare = engine.empty(second * third)
            self.reading = engine.fetched([np.empty(third)])

    def start(self, coefficients: Any) -> None:
        """Start the launches for the coefficients in a buffer."""
        if self.is_whole:
            return
        _, second, third = self.counts
        engine, kernels = self.engine, self.kernels
        engine.launch(
            kernels["greatest_outside"], [coefficients, *self.counts, *self.part], [self.spare], second * third
        )
        engine.launch(kernels["block_maxima"], [self.spare, second, third, second], [*self.reading.buffers], third)
        self.reading.start()

    def contains(self, potential: float) -> bool:
        """Wait, and return whether all coefficients outside are at most this potential, see support.left_out."""
        return self.is_whole or float(self.reading.wait()[0].max()) <= potential
