"""Compute the tables of a grid that planning needs on the engine's device.

A GPU does so for every volume, a CPU for grids of many nodes and for those whose values change repeatedly.

These are the spline's coefficients, the greatest of their fourth differences in blocks (step_bound.py), of the
potential in blocks (unresolved.py) and of the coefficients in each plane across an axis (support.py): half of the work
of preparing a known pupil for new values. The results are cached on the grid under the keys that NumPy's results would
have, and are the same except for rounding.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ..medium.grid import FETCH, UniformGrid
from ..medium.grid_places import known
from ..medium.spline import pivots
from .engines import Engine
from .engines.kernel_table import GRID_KERNELS
from .step_bound import block_size

# Grids of fewer nodes are as fast on the host: volumes, and those of two axes, for which a CPU makes the spline.
LEAST_NODES = 1 << 15  # speed only
LEAST_FLAT = 1 << 12  # speed only
# A CPU loads the kernels for a single field of so many nodes; for fewer NumPy is done before they are loaded.
MANY_NODES = 1 << 20  # speed only
# Least number of nodes along an axis: the elimination needs four; and along the last axis: those of a CPU's vectors.
LEAST_COUNT, LEAST_LAST = 4, 8
# Pivots of the elimination that are cached with a grid's node positions.
CACHED = 6  # speed only


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
    shape = grid.shape
    is_flat = len(shape) == 2
    if grid.interpolation != "cubic" or len(shape) < 2 or min(shape) < LEAST_COUNT or shape[-1] < LEAST_LAST:
        return _nothing
    if grid.samples.size < (LEAST_FLAT if is_flat else LEAST_NODES) or (is_flat and engine.is_gpu):
        return _nothing
    is_known = "coefficients" in grid.__dict__ or grid.held(FETCH) is not None
    size = 8 * math.prod(count + 2 for count in shape)
    if is_known or not engine.grid_tables or size > engine.memory[1]:
        return _nothing
    tables = _Tables(engine, grid)
    read = tables.started(engine.grid_tables)

    def finish() -> None:
        found = read()
        engine.settle()
        grid.derive(engine.grid_key, lambda: tables.coefficients)
        # Not a method of the tables, which have the grid: a cycle would keep its memory, on the device too.
        fetch = partial(_fetched, engine, tables.coefficients, tables.on_host, grid.coefficient_shape)
        grid.derive(FETCH, lambda: fetch)
        for name, table in found.items():
            grid.derive(name, partial(lambda table: table, table))

    return finish


def _nothing() -> None:
    """Do nothing: the host computes the tables, or they are known."""


class _Tables:
    """A grid on a device, and the launches that reduce it."""

    def __init__(self, engine: Engine, grid: UniformGrid):
        self.engine, self.grid, self.kernels = engine, grid, engine.kernels(GRID_KERNELS)
        self.block = block_size(grid)
        self.samples = engine.share(grid.samples.reshape(-1))
        # On a CPU the coefficients share memory with the host: allocating memory takes as long as a spline.
        self.on_host = None if engine.is_gpu else np.empty(math.prod(grid.coefficient_shape))
        *others, last = grid.shape
        self.spare = engine.empty(math.prod(count + 2 for count in others) * last)
        self.coefficients = self._spline()

    def _spline(self) -> Any:
        """Coefficients of the potential's spline, axis by axis."""
        values, shape, engine = self.samples, list(self.grid.shape), self.engine
        count = math.prod(self.grid.coefficient_shape)
        whole = engine.empty(count) if self.on_host is None else engine.share(self.on_host)
        for axis, made in enumerate((whole, self.spare, whole)[-len(shape) :]):
            nodes, pitch = shape[axis], math.prod(shape[axis + 1 :])
            even = self.grid.even_first_axis and axis == 0
            inverse = known(
                self.grid, ("pivots", *engine.grid_key, nodes, even), partial(self._pivots, nodes, even), CACHED
            )
            lines = math.prod(shape) // nodes
            shape[axis] += 2
            ambient = self.grid.ambient_index if axis == 0 else 0.0
            before = [values, inverse, nodes, pitch, int(even), ambient]
            engine.launch(self.kernels["spline_lines"], before, [made], lines)
            values = made
        return values

    def _pivots(self, nodes: int, even: bool) -> Any:
        return self.engine.put(pivots(nodes, even))

    def started(self, names: tuple[str, ...]) -> Callable[[], dict[str, Any]]:
        """Start the launches of some tables; return a function that waits for the tables, by name."""
        blocks = [_blocks(count, self.block) for count in self.grid.shape]
        sizes = [4 * math.prod(blocks)]
        if "potential peaks" in names:
            first, second, third = _three(self.grid.coefficient_shape)
            sizes += [second * third, first * third]
        reading = self.engine.fetched([np.empty(size) for size in sizes])
        in_blocks, *lines = reading.buffers
        self._by_blocks(in_blocks)
        if lines:
            self._peaks(*lines)
        reading.start()

        def read() -> dict[str, Any]:
            in_blocks, *lines = reading.taken()
            *fourth, potential = in_blocks.reshape(4, *blocks)  # of a grid of two axes the first is of no axis
            found = {"roughness": self._by_axis(*fourth), "potential by blocks": potential}
            if lines:
                peaks = _peaks_of(lines[0].reshape(second, third), lines[1].reshape(first, third))
                found["potential peaks"] = peaks[-len(blocks) :]
            return found

        return read

    def _by_blocks(self, made: Any) -> None:
        """Launch the greatest fourth differences along each axis and potential in each block, into this buffer."""
        grid = self.grid
        first, second, third = _three(grid.shape)
        columns = _blocks(first, self.block) * _blocks(second, self.block) * third
        even = int(grid.even_first_axis and first == 1)
        before = [self.coefficients, self.samples, first, second, third, self.block, even, grid.ambient_index]
        self.engine.launch(self.kernels["column_maxima"], before, [self.spare], columns)
        self._maxima(self.spare, 1, 4 * columns // third, third, self.block, made)

    def _by_axis(self, *fourth: np.ndarray) -> tuple[int, list[np.ndarray], list[np.ndarray]]:
        """Convert to the form of step_bound.roughness_of_blocks."""
        scales = [self.grid.ambient_index * spacing**4 for spacing in self.grid.spacing]
        derivatives = [part / scale for part, scale in zip(fourth[-len(scales) :], scales, strict=True)]
        return self.block, derivatives, [np.zeros(derivatives[0].shape)] * len(scales)

    def _peaks(self, planes: Any, rows: Any) -> None:
        """Launch the greatest absolute coefficients along the first axis, and along the second, into these buffers.

        Lines of the last axis are contiguous in memory, which would be slower.
        """
        first, second, third = _three(self.grid.coefficient_shape)
        self._maxima(self.coefficients, second * third, 1, first, first, planes)
        self._maxima(self.coefficients, third, first, second, second, rows)

    def _maxima(self, values: Any, pitch: int, outer: int, count: int, block: int, made: Any) -> None:
        """Launch the greatest absolute values over the nodes of blocks along an axis, into the buffer `made`."""
        places = outer * _blocks(count, block) * pitch
        self.engine.launch(self.kernels["block_maxima"], [values, count, pitch, block], [made], places)


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
    """Convert to the form of support.py: the greatest absolute coefficient in each plane across an axis."""
    return [over_second.max(axis=1), over_first.max(axis=1), over_first.max(axis=0)]


def _three(shape: tuple[int, ...]) -> tuple[int, int, int]:
    """The shape of a grid as that of a volume; one of two axes is a single layer."""
    first, second, third = (1, *shape)[-3:]
    return first, second, third


def _blocks(count: int, block: int) -> int:
    """Number of blocks of the cells between so many nodes."""
    return max(count - 2, 0) // block + 1
