"""The roughness of a field around every place: the greatest that a tube of rays of a given width can meet there.

The field is divided into blocks of a few cells. For each block, and for blocks two, four ... times as wide, a table
holds the greatest fourth derivative along each axis and the greatest kink in the block and its neighbours. This covers
everything within one block's width of any place in the block.
"""

from dataclasses import dataclass

import numpy as np

from ...medium import IndexField
from ...medium.grid import UniformGrid
from ..blocks import greatest_around
from ..step_bound import roughness_of_blocks

# Levels of blocks, each of twice the width.
LEVELS = 12


@dataclass(frozen=True, eq=False)
class Roughness:
    """Greatest roughness within a block's width of any place of a field, for a series of widths.

    Attributes:
        low: Corner of the first block along the local axes [m].
        size: Widths of the narrowest blocks [m], shape (d,).
        cell: Widths of cells [m], shape (d,).
        levels: For each level the greatest fourth root of the fourth derivative along each axis [1/m] and kink [1],
            shape (*blocks, 2 d).
    """

    low: np.ndarray
    size: np.ndarray
    cell: np.ndarray
    levels: tuple[np.ndarray, ...]

    def at(self, place: np.ndarray, width: np.ndarray) -> np.ndarray:
        """Greatest roughness within `width` [m, per axis] of places, shapes (n, d): shape (n, 2 d), 0 outside."""
        with np.errstate(divide="ignore"):
            level = np.ceil(np.log2(np.maximum(width / self.size, 1e-9)).max(axis=1))
        level = np.clip(level, 0, len(self.levels) - 1).astype(int)
        found = np.zeros((len(place), 2 * len(self.low)))
        for number in np.unique(level):
            table = self.levels[number]
            count = np.array(table.shape[:-1])
            rows = np.flatnonzero(level == number)
            index = np.floor((place[rows] - self.low) / (self.size * 2.0**number)).astype(np.int64)
            near = ((index >= -1) & (index <= count)).all(axis=1)
            index = np.clip(index, 0, count - 1)
            found[rows] = np.where(near[:, None], table[tuple(index.T)], 0.0)
        return found


def roughness_of(field: IndexField) -> Roughness | None:
    """The roughness of a field, cached on its grid; None where it is not known."""
    if not isinstance(field.samples, UniformGrid):
        return None
    grid = field.samples
    return grid.derive("roughness at every width", lambda: _of_grid(grid))


def _of_grid(grid: UniformGrid) -> Roughness:
    block, fourth, kink = roughness_of_blocks(grid)
    table = np.stack([*(np.sqrt(np.sqrt(part)) for part in fourth), *kink], axis=-1)
    levels = []
    for _ in range(LEVELS):
        wide = table
        for axis in range(table.ndim - 1):
            wide = greatest_around(wide, -1, 1, axis)
        levels.append(np.ascontiguousarray(wide))
        if max(table.shape[:-1]) == 1:
            break
        table = _halved(table)
    cell = np.asarray(grid.spacing, dtype=float)
    return Roughness(np.asarray(grid.low, dtype=float), block * cell, cell, tuple(levels))


def _halved(table: np.ndarray) -> np.ndarray:
    for axis in range(table.ndim - 1):
        if table.shape[axis] % 2:
            width = [(0, 1) if other == axis else (0, 0) for other in range(table.ndim)]
            table = np.pad(table, width)
        even, odd = (table.take(range(first, table.shape[axis], 2), axis) for first in (0, 1))
        table = np.maximum(even, odd)
    return table
