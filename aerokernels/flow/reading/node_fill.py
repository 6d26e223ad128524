"""Nodes of a grid that no single cell speaks for: several small cells about them, or none at all."""

import numpy as np

from .dataset import Block
from .raster import CellFacts, NodeGrid
from .reconstruction import Rows

LEAST_AVERAGED = 4  # cells about a node from which on their average says more than the one that holds it
CARRIED_ON = 8  # nodes by which the density is carried on into a body, and beyond the mesh


class SmallCells:
    """Nodes about which several cells have their middles, which take their average, by volume."""

    def __init__(self, grid: NodeGrid, facts: list[CellFacts], blocks: list[Block], held: np.ndarray):
        """Find them, and the shares of their cells."""
        middle = np.concatenate([own.middle for own in facts])
        volume = np.abs(np.concatenate([own.volume for own in facts]))
        index = np.round((middle - grid.low) / grid.spacing)
        inside = (volume > 0.0) & np.all((index >= 0) & (index < grid.shape), axis=1)
        blank = [
            b.blank if b.blank is not None and len(b.blank) == b.cell_count else np.zeros(b.cell_count, bool)
            for b in blocks
        ]
        inside &= ~np.concatenate(blank)
        cell = np.flatnonzero(inside)
        node = np.ravel_multi_index(tuple(index[cell].astype(np.int64).T), grid.shape)
        count = np.bincount(node, minlength=len(held))
        total = np.bincount(node, volume[cell], len(held))
        # Cells that fill most of the node's surroundings: fewer would shift the average to one side.
        several = (count >= LEAST_AVERAGED) & held & (total >= 0.7 * grid.spacing.prod())
        self.share = float(several.mean())
        self.node = np.flatnonzero(several)
        number = np.zeros(len(held), np.int32)
        number[self.node] = np.arange(len(self.node))
        some = several[node]
        self._cell, self._of = cell[some], number[node[some]]
        self._share = volume[self._cell] / total[self.node][self._of]

    def average(self, value: np.ndarray, density: np.ndarray) -> None:
        """Give these nodes the averages of `value`, one of each cell."""
        if len(self.node):
            density[self.node] = np.bincount(self._of, self._share * value[self._cell], len(self.node))


def foremost(held: np.ndarray, shape) -> np.ndarray:
    """The nodes of the foremost twentieth of the layers that the mesh holds."""
    inside = held.reshape(shape)
    layers = np.flatnonzero(inside.any(axis=(0, 1)))
    first = int(layers[int(0.95 * (len(layers) - 1))])
    across, layer = np.nonzero(inside.reshape(-1, shape[2])[:, first:])
    return np.asarray(across * shape[2] + first + layer)


class EmptyNodes:
    """Nodes without a cell: the mean of their neighbours, layer by layer; deeper ones are ambient."""

    def __init__(self, held: np.ndarray, shape):
        """Find them, and whose means they take."""
        known = held.copy()
        empty = np.flatnonzero(~known)
        strides = (shape[1] * shape[2], shape[2], 1)
        self._layers: list[tuple[np.ndarray, Rows]] = []
        for _ in range(CARRIED_ON):
            if not len(empty):
                break
            place = np.unravel_index(empty, shape)
            row, near = [], []
            for axis, stride in enumerate(strides):
                for side in (-1, 1):
                    there = (place[axis] > 0) if side < 0 else (place[axis] < shape[axis] - 1)
                    good = there & known[np.where(there, empty + side * stride, empty)]
                    row.append(np.flatnonzero(good))
                    near.append(empty[good] + side * stride)
            rows = Rows.sorted(np.concatenate(row), np.concatenate(near), len(empty))[0]
            found = np.diff(rows.start) > 0
            self._layers.append((empty[found], Rows(np.append(rows.start[:-1][found], rows.start[-1]), rows.column)))
            known[empty[found]] = True
            empty = empty[~found]
        self._deep = empty

    def fill(self, density: np.ndarray, ambient: float) -> None:
        """Give them their densities."""
        density[self._deep] = ambient
        for node, rows in self._layers:
            density[node] = rows.means(density)
