"""Compute the tables of a grid that planning needs on the engine's device: NumPy's results, but for rounding.

A GPU does so for every volume, a CPU for grids of many float64 nodes and for those whose values change repeatedly.
"""

import math
from functools import partial
from typing import Any

import numpy as np

from aerokernels.medium.grid import GridPlaces
from aerokernels.tracing.tasks.unresolved import potential_by_blocks

from ..derived import Cached, cached_on
from ..medium.grid import FETCH, UniformGrid
from ..medium.spline import pivots
from .engines import Engine
from .engines.interface import PROGRAMS
from .error_limit import potential_peaks
from .step_bound import block_size, roughness_of_blocks

# Grids of fewer nodes are as fast on the host: volumes, and those of two axes, for which a CPU makes the spline.
LEAST_NODES = 1 << 15  # speed only
LEAST_FLAT = 1 << 12  # speed only
# A CPU loads the kernels for a single field of so many nodes; for fewer NumPy is done before they are loaded.
MANY_NODES = 1 << 20  # speed only
# Least number of nodes along an axis: the elimination needs four; and along the last axis: those of a CPU's vectors.
LEAST_COUNT, LEAST_LAST = 4, 8


def prepare_once(engine: Engine, grid: Any) -> None:
    """`prepare_grid`, if that is faster than NumPy for a grid that is planned once; no mesh needs it."""
    if isinstance(grid, UniformGrid) and (engine.is_gpu or grid.samples.size >= MANY_NODES):
        prepare_grid(engine, grid)


def prepare_grid(engine: Engine, grid: UniformGrid) -> None:
    """Compute on a device the tables of a cubic volume that planning needs, or the spline of a grid of two axes.

    Raises:
        ValueError: The grid does not fit the device.
    """
    is_flat = len(grid.shape) == 2
    is_slower = grid.samples.size < (LEAST_FLAT if is_flat else LEAST_NODES) or (is_flat and engine.is_gpu)
    # A CPU's tables are of float64: those of float32 samples are made by slabs, which take a third of the memory.
    is_slower |= grid.samples.dtype == np.float32 and not engine.is_gpu
    is_known = "coefficients" in grid.__dict__ or grid.held(FETCH) is not None
    if is_slower or is_known or not has_tables(engine, grid):
        return
    tables = _GridTables(engine, grid)
    found = tables.computed(engine.share(grid.doubles))
    engine.settle()
    grid.derive(engine.grid_key, lambda: tables.coefficients)
    # Without the tables themselves, which have a grid: a cycle would keep its memory, on the device too.
    fetch = partial(_fetched, engine, tables.coefficients, tables.on_host, grid.coefficient_shape)
    grid.derive(FETCH, lambda: fetch)
    for function, table in found.items():
        function.keep(table, grid)


def has_tables(engine: Engine, grid: UniformGrid) -> bool:
    """Whether the engine's device computes the tables of such a grid."""
    shape = grid.shape
    if grid.interpolation != "cubic" or len(shape) < 2 or min(shape) < LEAST_COUNT or shape[-1] < LEAST_LAST:
        return False
    return bool(engine.grid_tables) and 8 * math.prod(count + 2 for count in shape) <= engine.memory[1]


class _GridTables:
    """Memory on a device for the tables of a grid; on a CPU the coefficients share that of the array `on_host`."""

    def __init__(self, engine: Engine, grid: UniformGrid):
        self.engine, self.grid = engine, grid
        self.kernels = engine.kernels(PROGRAMS["grid_tables"])
        self.block = block_size(grid)
        self.blocks = [_blocks(count, self.block) for count in grid.shape]
        count = math.prod(grid.coefficient_shape)
        self.on_host = None if engine.is_gpu else np.zeros(count)
        self.coefficients = engine.empty(count) if self.on_host is None else engine.share(self.on_host)
        *others, last = grid.shape
        self.spare = engine.empty(math.prod(count + 2 for count in others) * last)

    def computed(self, samples: Any) -> dict[Cached, Any]:
        """The tables of the samples in a buffer, on the host, by the functions whose results they are."""
        first, second, third = _three(self.grid.coefficient_shape)
        sizes = [4 * math.prod(self.blocks)]
        if "potential peaks" in self.engine.grid_tables:
            sizes += [second * third, first * third]
        reading = self.engine.fetched([np.empty(size) for size in sizes])
        by_blocks, *lines = reading.buffers
        self._spline(samples)
        self._by_blocks(samples, by_blocks)
        if lines:
            # The greatest absolute coefficients along the first axis, and along the second.
            self._maxima(self.coefficients, second * third, 1, first, first, lines[0])
            self._maxima(self.coefficients, third, first, second, second, lines[1])
        reading.start()
        in_blocks, *greatest = (array.copy() for array in reading.wait())
        *fourth, potential = in_blocks.reshape(4, *self.blocks)  # of a grid of two axes the first is of no axis
        scales = [self.grid.ambient_index * spacing**4 for spacing in self.grid.spacing]
        derivatives = [part / scale for part, scale in zip(fourth[-len(scales) :], scales, strict=True)]
        roughness = self.block, derivatives, [np.zeros(derivatives[0].shape)] * len(scales)
        found: dict[Cached, Any] = {roughness_of_blocks: roughness, potential_by_blocks: potential}
        if greatest:
            over_first, over_second = greatest[0].reshape(second, third), greatest[1].reshape(first, third)
            peaks = [over_second.max(axis=1), over_first.max(axis=1), over_first.max(axis=0)]
            found[potential_peaks] = peaks[-len(self.blocks) :]
        return found

    def _spline(self, values: Any) -> None:
        """Launch the spline of the potential, axis by axis, from a buffer of samples."""
        shape, engine = list(self.grid.shape), self.engine
        whole = self.coefficients
        buffers = (whole, self.spare, whole)[-len(shape) :]
        for axis, made in enumerate(buffers):
            nodes, pitch = shape[axis], math.prod(shape[axis + 1 :])
            even = self.grid.even_first_axis and axis == 0
            inverse = _pivots(self.grid.places, engine, nodes, even)
            lines = math.prod(shape) // nodes
            shape[axis] += 2
            ambient = self.grid.ambient_index if axis == 0 else 0.0
            before = [values, inverse, nodes, pitch, int(even), ambient]
            engine.launch(self.kernels["spline_lines"], before, [made], lines)
            values = made

    def _by_blocks(self, samples: Any, made: Any) -> None:
        """Launch the greatest fourth differences along each axis and potential in each block, into this buffer."""
        grid = self.grid
        first, second, third = _three(grid.shape)
        columns = _blocks(first, self.block) * _blocks(second, self.block) * third
        even = int(grid.even_first_axis and first == 1)
        before = [self.coefficients, samples, first, second, third, self.block, even, grid.ambient_index]
        self.engine.launch(self.kernels["column_maxima"], before, [self.spare], columns)
        self._maxima(self.spare, 1, 4 * columns // third, third, self.block, made)

    def _maxima(self, values: Any, pitch: int, outer: int, count: int, block: int, made: Any) -> None:
        """Launch the greatest absolute values over the nodes of blocks along an axis, into the buffer `made`."""
        places = outer * _blocks(count, block) * pitch
        self.engine.launch(self.kernels["block_maxima"], [values, count, pitch, block], [made], places)


@cached_on("places", 6)
def _pivots(places: GridPlaces, engine: Engine, nodes: int, even: bool) -> Any:
    return engine.put(pivots(nodes, even))


def _fetched(engine: Engine, coefficients: Any, on_host: np.ndarray | None, shape: tuple[int, ...]) -> np.ndarray:
    """The coefficients on the host."""
    if on_host is not None:
        engine.wait()
        on_host.setflags(write=False)
        return on_host.reshape(shape)
    found = np.empty(shape)
    engine.get(coefficients, found.reshape(-1))
    return found


def _three(shape: tuple[int, ...]) -> tuple[int, int, int]:
    """The shape of a grid as that of a volume; one of two axes is a single layer."""
    first, second, third = (1, *shape)[-3:]
    return first, second, third


def _blocks(count: int, block: int) -> int:
    """Number of blocks of the cells between so many nodes."""
    return max(count - 2, 0) // block + 1
