"""Compute the tables of a grid that planning needs on the engine's device.

A GPU does so for every volume, a CPU for grids of many float64 nodes and for those whose values change repeatedly.

These are the spline's coefficients, the greatest of their fourth differences in blocks (step_bound.py), of the
potential in blocks (unresolved.py) and of the coefficients in each plane across an axis (error_limit.py): half of the
work of preparing a known pupil for new values. The results are cached on the grid under the keys that NumPy's results
would have, and are the same except for rounding.
"""

import math
from collections.abc import Callable
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
# Launches of one kernel for a grid, at most.
MOST_LAUNCHES = 3


def prepare_grid(engine: Engine, grid: UniformGrid) -> None:
    """Compute on a device the tables of a cubic volume that planning needs, or the spline of a grid of two axes.

    Raises:
        ValueError: The grid does not fit the device.
    """
    begun_grid(engine, grid)()


def prepare_once(engine: Engine, grid: Any) -> None:
    """`prepare_grid`, if that is faster than NumPy for a grid whose values are not known to change; no mesh needs it.

    Raises:
        ValueError: The grid does not fit the device.
    """
    if isinstance(grid, UniformGrid) and (engine.is_gpu or grid.samples.size >= MANY_NODES):
        prepare_grid(engine, grid)


def begun_grid(engine: Engine, grid: UniformGrid) -> Callable[[], None]:
    """Start what `prepare_grid` computes; return a function that waits for it, which must be called.

    Until then the device may write into memory of the grid's coefficients.

    Raises:
        ValueError: The grid does not fit the device.
    """
    is_flat = len(grid.shape) == 2
    is_slower = grid.samples.size < (LEAST_FLAT if is_flat else LEAST_NODES) or (is_flat and engine.is_gpu)
    # A CPU's tables are of float64: those of float32 samples are made by slabs, which take a third of the memory.
    is_slower |= grid.samples.dtype == np.float32 and not engine.is_gpu
    is_known = "coefficients" in grid.__dict__ or grid.held(FETCH) is not None
    return _nothing if is_slower or is_known or not has_tables(engine, grid) else GridTables(engine, grid).begun(grid)


def has_tables(engine: Engine, grid: UniformGrid) -> bool:
    """Whether the engine's device computes the tables of such a grid."""
    shape = grid.shape
    if grid.interpolation != "cubic" or len(shape) < 2 or min(shape) < LEAST_COUNT or shape[-1] < LEAST_LAST:
        return False
    return bool(engine.grid_tables) and 8 * math.prod(count + 2 for count in shape) <= engine.memory[1]


def keep_tables(grid: UniformGrid, tables: dict[Cached, Any]) -> None:
    """Cache tables that `GridTables.read` has returned on the grid from whose samples they were made."""
    for function, table in tables.items():
        function.keep(table, grid)


def _nothing() -> None:
    """Do nothing: the host computes the tables, or they are known."""


class GridTables:
    """Memory on a device for the tables of grids on the same nodes, and the launches that compute them.

    Attributes:
        coefficients: The buffer of the spline's coefficients.
        on_host: On a CPU the array with which it shares memory: allocating memory takes as long as a spline.
    """

    def __init__(self, engine: Engine, grid: UniformGrid):
        """Allocate memory for grids like this one: with the same nodes and the same ambient index."""
        self.engine, self.grid = engine, grid
        # One for each launch: a launch that is started again then sets no argument.
        self.kernels = [engine.kernels(PROGRAMS["grid_tables"]) for _ in range(MOST_LAUNCHES)]
        self.block = block_size(grid)
        self.blocks = [_blocks(count, self.block) for count in grid.shape]
        count = math.prod(grid.coefficient_shape)
        self.on_host = None if engine.is_gpu else np.zeros(count)
        self.coefficients = engine.empty(count) if self.on_host is None else engine.share(self.on_host)
        *others, last = grid.shape
        self.spare = engine.empty(math.prod(count + 2 for count in others) * last)
        sizes = [4 * math.prod(self.blocks)]
        if "potential peaks" in engine.grid_tables:
            first, second, third = _three(grid.coefficient_shape)
            sizes += [second * third, first * third]
        self.reading = engine.fetched([np.empty(size) for size in sizes])

    def begun(self, grid: UniformGrid) -> Callable[[], None]:
        """Start for the samples of a grid, which then owns the coefficients; return what waits and caches all on it."""
        self.start(self.engine.share(grid.doubles))

        def finish() -> None:
            found, engine = self.read(), self.engine
            engine.settle()
            grid.derive(engine.grid_key, lambda: coefficients)
            # Not a method of these tables, which have a grid: a cycle would keep its memory, on the device too.
            fetch = partial(_fetched, engine, coefficients, self.on_host, grid.coefficient_shape)
            grid.derive(FETCH, lambda: fetch)
            keep_tables(grid, found)

        coefficients = self.coefficients
        return finish

    def start(self, samples: Any) -> None:
        """Start the launches for the samples in a buffer."""
        self._spline(samples)
        self._by_blocks(samples, self.in_blocks)

    @property
    def in_blocks(self) -> Any:
        """The buffer of the greatest fourth differences along three axes in each block, and of the potential there."""
        return self.reading.buffers[0]

    def read(self) -> dict[Cached, Any]:
        """Copy the tables of the last `start` to the host, and return them by the functions whose results they are."""
        _, *lines = self.reading.buffers
        if lines:
            self._peaks(*lines)
        self.reading.start()
        in_blocks, *greatest = (array.copy() for array in self.reading.wait())
        *fourth, potential = in_blocks.reshape(4, *self.blocks)  # of a grid of two axes the first is of no axis
        found: dict[Cached, Any] = {roughness_of_blocks: self._by_axis(*fourth), potential_by_blocks: potential}
        if greatest:
            first, second, third = _three(self.grid.coefficient_shape)
            peaks = _peaks_of(greatest[0].reshape(second, third), greatest[1].reshape(first, third))
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
            engine.launch(self.kernels[axis]["spline_lines"], before, [made], lines)
            values = made

    def _by_blocks(self, samples: Any, made: Any) -> None:
        """Launch the greatest fourth differences along each axis and potential in each block, into this buffer."""
        grid = self.grid
        first, second, third = _three(grid.shape)
        columns = _blocks(first, self.block) * _blocks(second, self.block) * third
        even = int(grid.even_first_axis and first == 1)
        before = [self.coefficients, samples, first, second, third, self.block, even, grid.ambient_index]
        self.engine.launch(self.kernels[0]["column_maxima"], before, [self.spare], columns)
        self._maxima(0, self.spare, 1, 4 * columns // third, third, self.block, made)

    def _by_axis(self, *fourth: np.ndarray) -> tuple[int, list[np.ndarray], list[np.ndarray]]:
        """Convert to the form of step_bound.roughness_of_blocks."""
        scales = [self.grid.ambient_index * spacing**4 for spacing in self.grid.spacing]
        derivatives = [part / scale for part, scale in zip(fourth[-len(scales) :], scales, strict=True)]
        return self.block, derivatives, [np.zeros(derivatives[0].shape)] * len(scales)

    def _peaks(self, planes: Any, rows: Any) -> None:
        """Launch the greatest absolute coefficients along the first axis, and along the second, into these buffers."""
        first, second, third = _three(self.grid.coefficient_shape)
        self._maxima(1, self.coefficients, second * third, 1, first, first, planes)
        self._maxima(2, self.coefficients, third, first, second, second, rows)

    def _maxima(self, number: int, values: Any, pitch: int, outer: int, count: int, block: int, made: Any) -> None:
        """Launch the greatest absolute values over the nodes of blocks along an axis, into the buffer `made`."""
        places = outer * _blocks(count, block) * pitch
        self.engine.launch(self.kernels[number]["block_maxima"], [values, count, pitch, block], [made], places)


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


def _peaks_of(over_first: np.ndarray, over_second: np.ndarray) -> list[np.ndarray]:
    """Convert to the form of error_limit.py: the greatest absolute coefficient in each plane across an axis."""
    return [over_second.max(axis=1), over_first.max(axis=1), over_first.max(axis=0)]


def _three(shape: tuple[int, ...]) -> tuple[int, int, int]:
    """The shape of a grid as that of a volume; one of two axes is a single layer."""
    first, second, third = (1, *shape)[-3:]
    return first, second, third


def _blocks(count: int, block: int) -> int:
    """Number of blocks of the cells between so many nodes."""
    return max(count - 2, 0) // block + 1
