"""Find the cell that contains each node of a uniform grid: cells are rasterised on all cores, in bounded memory."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from threading import Lock
from typing import Any

import numpy as np

from aerokernels.flow.reading.dataset import Block
from aerokernels.flow.reading.volumes.solids import Solids, solid_chunks
from aerokernels.process.machine import core_count

PAIRS = 400_000  # pairs of a cell and a node in its box that are tested together
ON_FACE = 1e-9  # of a cell's size: a node this close is on the face


@dataclass(frozen=True, eq=False)
class NodeGrid:
    """A uniform grid of nodes, and the cell that contains each.

    Attributes:
        low: The first node [m], shape (3,).
        spacing: [m], shape (3,).
        shape: Nodes along x, y, z.
        cell: The cell of each node, -1 for none, shape (node_count,) with z fastest.
        lock: Held while nodes are given their cells.
    """

    low: np.ndarray
    spacing: np.ndarray
    shape: tuple[int, int, int]
    cell: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=np.int32))
    lock: Any = field(default_factory=Lock)

    def __post_init__(self):
        """Start with no cell for any node."""
        if not len(self.cell):
            object.__setattr__(self, "cell", np.full(int(np.prod(self.shape)), -1, dtype=np.int32))

    def positions(self, node: np.ndarray) -> np.ndarray:
        """Return coordinates [m] of nodes by their number, shape (n, 3)."""
        index = np.stack(np.unravel_index(node, self.shape), axis=1)
        return self.low + index * self.spacing


@dataclass(eq=False)
class CellFacts:
    """Volumes and centroids of all cells of a block.

    Attributes:
        volume: [m3], shape (cell_count,).
        middle: Centroids [m], shape (cell_count, 3).
    """

    volume: np.ndarray
    middle: np.ndarray


def rasterise(block: Block, points: np.ndarray, grids: list[NodeGrid], first_cell: int) -> CellFacts:
    """Rasterise the solid cells of a block into grids, where their numbers begin with `first_cell`."""
    count = block.cell_count
    facts = CellFacts(np.zeros(count), np.zeros((count, 3)))
    blank = block.blank if block.blank is not None and len(block.blank) == count else None
    across = np.ascontiguousarray(points.T)

    def work(made: Callable[[], Solids]) -> None:
        solids = made()
        facts.volume[solids.cell] = solids.volume
        facts.middle[solids.cell] = solids.middle.T
        for grid in grids:
            _rasterise_some(solids, grid, first_cell, blank)

    threads = core_count()
    with ThreadPoolExecutor(threads) as pool:
        waiting = []
        for made in solid_chunks(block, across):
            waiting.append(pool.submit(work, made))
            if len(waiting) >= 2 * threads:  # bound the memory of chunks in progress
                waiting.pop(0).result()
        for last in waiting:
            last.result()
    return facts


def _rasterise_some(solids: Solids, grid: NodeGrid, first_cell: int, blank: np.ndarray | None) -> None:
    shape, step, low = np.array(grid.shape)[:, None], grid.spacing[:, None], grid.low[:, None]
    slack = ON_FACE * (solids.high - solids.low).max(axis=0) + 1e-12 * grid.spacing.max()
    begin = np.clip(np.ceil((solids.low - slack - low) / step), 0, shape).astype(np.int64)
    end = np.clip(np.floor((solids.high + slack - low) / step), -1, shape - 1).astype(np.int64)
    span = np.maximum(end - begin + 1, 0)
    pairs = span.prod(axis=0)
    if blank is not None:
        pairs[blank[solids.cell]] = 0
    some = np.flatnonzero(pairs)
    if not len(some):
        return
    area = solids.area[:, :, some]
    size = np.sqrt((area**2).sum(axis=0))
    turn = np.where(solids.volume[some] < 0.0, -1.0, 1.0)
    normal = area * (turn / np.where(size > 0.0, size, 1.0))
    # normal . (node - middle) <= bound, relative to the middle so that no digits are lost
    middle = solids.middle[:, some]
    bound = (normal * (solids.centre[:, :, some] - middle[:, None])).sum(axis=0) + slack[some]
    cell, begin, span, pairs = first_cell + solids.cell[some], begin[:, some], span[:, some], pairs[some]
    ends = np.cumsum(pairs)
    first = 0
    while first < len(some):
        before = ends[first - 1] if first else 0
        last = max(first + 1, int(np.searchsorted(ends, before + PAIRS, "right")))
        part = slice(first, last)
        _assign_inside(grid, cell[part], begin[:, part], span[:, part], pairs[part], middle[:, part],
              normal[:, :, part], bound[:, part])  # fmt: skip
        first = last


def _assign_inside(grid, cell, begin, span, pairs, middle, normal, bound) -> None:
    own = np.repeat(np.arange(len(cell)), pairs)
    within = np.arange(len(own)) - np.repeat(np.cumsum(pairs) - pairs, pairs)
    rest, k = np.divmod(within, span[2][own])
    i, j = np.divmod(rest, span[1][own])
    index = [axis + first[own] for axis, first in zip((i, j, k), begin, strict=True)]
    node = (index[0] * grid.shape[1] + index[1]) * grid.shape[2] + index[2]
    place = [(grid.low[axis] - middle[axis])[own] + grid.spacing[axis] * index[axis] for axis in range(3)]
    for face in range(normal.shape[1]):
        distance = place[0] * normal[0, face][own]
        distance += place[1] * normal[1, face][own]
        distance += place[2] * normal[2, face][own]
        inside = np.flatnonzero(distance <= bound[face][own])
        if len(inside) < len(own):
            own, node = own[inside], node[inside]
            place = [axis[inside] for axis in place]
    # A node on a face shared by cells goes to the one with the greatest number, whichever thread comes first.
    with grid.lock:
        grid.cell[node] = np.maximum(grid.cell[node], cell[own])
