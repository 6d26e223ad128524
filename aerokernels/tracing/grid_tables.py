"""Compute the tables of a grid that planning needs on the engine's device, for fields whose values change repeatedly.

These are the spline's coefficients, the greatest of their fourth differences in blocks (step_bound.py), of the
potential in blocks (unresolved.py) and of the coefficients in each plane across an axis (support.py): half of the work
of preparing a known pupil for new values. The results are cached on the grid under the keys that NumPy's results would
have, and are the same except for rounding.
"""

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
# Least number of nodes along an axis: the elimination needs four.
LEAST_COUNT = 4
# Pivots of the elimination that are cached with a grid's node positions.
CACHED = 6  # speed only


def prepare_grid(engine: Engine, grid: UniformGrid) -> None:
    """Compute on a device the tables of a cubic volume that planning needs, or the spline of a grid of two axes.

    Raises:
        ValueError: The grid does not fit the device.
    """
    shape = grid.shape
    is_flat = len(shape) == 2
    if grid.interpolation != "cubic" or min(shape) < LEAST_COUNT or len(shape) < 2:
        return
    if grid.samples.size < (LEAST_FLAT if is_flat else LEAST_NODES) or (is_flat and engine.is_gpu):
        return
    is_known = "coefficients" in grid.__dict__ or grid.held(FETCH) is not None
    size = 8 * np.prod(np.array(shape) + 2)
    if is_known or not engine.grid_tables or size > engine.memory[1]:
        return
    tables = _Tables(engine, grid, GRID_KERNELS[:1] if is_flat else GRID_KERNELS)
    found = tables.found(() if is_flat else engine.grid_tables)
    engine.settle()
    grid.derive(engine.grid_key, lambda: tables.coefficients)
    grid.derive(FETCH, lambda: tables.fetched)
    for name, table in found.items():
        grid.derive(name, partial(lambda table: table, table))
    tables.samples = tables.spare = None


class _Tables:
    """A grid on a device, and the launches that reduce it."""

    def __init__(self, engine: Engine, grid: UniformGrid, names: tuple[str, ...]):
        self.engine, self.grid, self.kernels = engine, grid, engine.grid_kernels(names)
        self.shape = grid.shape
        self.block = block_size(grid)
        self.samples = engine.share(grid.samples.reshape(-1))
        # On a CPU the coefficients share memory with the host: allocating memory takes as long as a spline.
        self.on_host = None if engine.is_gpu else np.empty(int(np.prod(grid.coefficient_shape)))
        *others, last = self.shape
        self.spare = engine.empty(int(np.prod(np.array(others) + 2)) * last)
        self.coefficients = self._spline()

    def _spline(self) -> Any:
        """Coefficients of the potential's spline, axis by axis."""
        values, shape, engine = self.samples, list(self.shape), self.engine
        count = int(np.prod(self.grid.coefficient_shape))
        whole = engine.empty(count) if self.on_host is None else engine.share(self.on_host)
        for axis, made in enumerate((whole, self.spare, whole)[-len(shape) :]):
            nodes, pitch = shape[axis], int(np.prod(shape[axis + 1 :]))
            even = self.grid.even_first_axis and axis == 0
            inverse = known(
                self.grid, ("pivots", *engine.grid_key, nodes, even), partial(self._pivots, nodes, even), CACHED
            )
            lines = int(np.prod(shape)) // nodes
            shape[axis] += 2
            ambient = self.grid.ambient_index if axis == 0 else 0.0
            before = [values, inverse, nodes, pitch, int(even), ambient]
            engine.launch(self.kernels["spline_lines"], before, [made], lines)
            values = made
        return values

    def _pivots(self, nodes: int, even: bool) -> Any:
        return self.engine.put(pivots(nodes, even))

    def fetched(self) -> np.ndarray:
        """The coefficients on the host."""
        if self.on_host is not None:
            self.engine.wait()
            self.on_host.setflags(write=False)
            return self.on_host.reshape(self.grid.coefficient_shape)
        found = np.empty(self.grid.coefficient_shape)
        self.engine.get(self.coefficients, found.reshape(-1))
        return found

    def found(self, names: tuple[str, ...]) -> dict[str, Any]:
        """Tables by name; all launches are started before any result is awaited."""
        makers: dict[str, tuple[Callable[[], list], Callable[..., Any]]] = {
            "roughness": (self._roughness, self._by_axis),
            "potential by blocks": (self._potential, lambda found: found),
            "potential peaks": (self._peaks, _peaks_of),
        }
        parts = {name: makers[name][0]() for name in names}
        several = [part for each in parts.values() for part in each]
        if not several:
            return {}
        reading = self.engine.fetched([buffer for buffer, _ in several], [array for _, array in several])
        reading.start()
        read = iter([array.copy() for array in reading.wait()])
        return {name: makers[name][1](*(next(read) for _ in each)) for name, each in parts.items()}

    def _roughness(self) -> list[tuple[Any, np.ndarray]]:
        """Launch the greatest fourth differences in blocks along each axis; return buffers and host arrays for them."""
        first, second, third = self.shape
        fourth = []
        for axis in range(3):
            shape = [_blocks(first, self.block), second, third]
            before = [self.coefficients, *self.shape, axis, self.block]
            self.engine.launch(self.kernels["fourth_differences"], before, [self.spare], int(np.prod(shape)))
            fourth.append(self._by_blocks(self.spare, shape, (1, 2)))
        return fourth

    def _by_axis(self, *fourth: np.ndarray) -> tuple[int, list[np.ndarray], list[np.ndarray]]:
        """Convert to the form of step_bound.roughness_of_blocks."""
        scales = [self.grid.ambient_index * spacing**4 for spacing in self.grid.spacing]
        derivatives = [part / scale for part, scale in zip(fourth, scales, strict=True)]
        return self.block, derivatives, [np.zeros_like(part) for part in fourth]

    def _potential(self) -> list[tuple[Any, np.ndarray]]:
        """Launch the greatest absolute potential over the ambient index in each block."""
        return [self._by_blocks(self.samples, list(self.shape), (0, 1, 2), self.grid.ambient_index)]

    def _peaks(self) -> list[tuple[Any, np.ndarray]]:
        """Launch the greatest absolute coefficients along the first axis, and along the second.

        Lines of the last axis are contiguous in memory, which would be slower.
        """
        first, second, third = (count + 2 for count in self.shape)
        planes = self._maxima(self.coefficients, second * third, 1, first, first, 0.0)
        rows = self._maxima(self.coefficients, third, first, second, second, 0.0)
        return [(planes, np.empty((second, third))), (rows, np.empty((first, third)))]

    def _by_blocks(
        self, values: Any, shape: list[int], axes: tuple[int, ...], ambient: float = 0.0
    ) -> tuple[Any, np.ndarray]:
        """Launch the greatest absolute values over the nodes of blocks along axes; return buffer and host array."""
        for axis in axes:
            pitch, outer = int(np.prod(shape[axis + 1 :])), int(np.prod(shape[:axis]))
            values = self._maxima(values, pitch, outer, shape[axis], self.block, ambient)
            shape[axis], ambient = _blocks(shape[axis], self.block), 0.0
        return values, np.empty(shape)

    def _maxima(self, values: Any, pitch: int, outer: int, count: int, block: int, ambient: float) -> Any:
        places = outer * _blocks(count, block) * pitch
        made = self.engine.empty(places)
        self.engine.launch(self.kernels["block_maxima"], [values, count, pitch, block, ambient], [made], places)
        return made


def _peaks_of(over_first: np.ndarray, over_second: np.ndarray) -> list[np.ndarray]:
    """Convert to the form of support.py: the greatest absolute coefficient in each plane across an axis."""
    return [over_second.max(axis=1), over_first.max(axis=1), over_first.max(axis=0)]


def _blocks(count: int, block: int) -> int:
    """Number of blocks of the cells between so many nodes."""
    return (count - 2) // block + 1
