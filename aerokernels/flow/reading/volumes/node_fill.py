"""Densities of grid nodes that no single cell determines: nodes among several small cells, or in no cell."""

import numpy as np

from aerokernels.flow.reading.dataset import Block
from aerokernels.flow.reading.volumes.point_values import LEAST_SHARE, lesser
from aerokernels.flow.reading.volumes.solids import CellFacts, NodeGrid


class SmallCells:
    """Nodes around which several cells have their centroids, and which take the volume average of these cells."""

    def __init__(self, grid: NodeGrid, facts: list[CellFacts], blocks: list[Block], held: np.ndarray):
        """Find the nodes, and the shares of their cells."""
        middle = np.concatenate([own.middle for own in facts])
        volume = np.abs(np.concatenate([own.volume for own in facts]))
        index = np.round((middle - grid.low) / grid.spacing)
        inside = (volume > 0.0) & np.all((index >= 0) & (index < grid.shape), axis=1)
        blank = [np.zeros(b.cell_count, bool) if b.blank is None else b.blank for b in blocks]
        inside &= ~np.concatenate(blank)
        cell = np.flatnonzero(inside)
        node = np.ravel_multi_index(tuple(index[cell].astype(np.int64).T), grid.shape)
        count = np.bincount(node, minlength=len(held))
        total = np.bincount(node, volume[cell], len(held))
        # The cells must fill most of the node's surroundings: otherwise the average would be one-sided.
        # Cells around a node: from this number on their average replaces the cell that contains it.
        several = (count >= 4) & held & (total >= 0.7 * grid.spacing.prod())
        self.node = np.flatnonzero(several)
        number = np.zeros(len(held), np.int32)
        number[self.node] = np.arange(len(self.node))
        some = several[node]
        self._cell, self._of = cell[some], number[node[some]]
        self._share = volume[self._cell] / total[self.node][self._of]
        self._centre((middle[self._cell] - grid.positions(self.node)[self._of]) / grid.spacing)
        self.share = len(self.node) / max(len(held), 1)

    def _centre(self, step: np.ndarray) -> None:
        """Adjust the shares so that their centroid is the node; drop nodes for which a share would be negative."""
        count = len(self.node)

        def total(each: np.ndarray) -> np.ndarray:
            return np.stack([np.bincount(self._of, own, count) for own in each.T], axis=1)

        mean = total(self._share[:, None] * step)
        away = step - mean[self._of]
        pairs = total((self._share[:, None, None] * away[:, :, None] * away[:, None, :]).reshape(-1, 9))
        turn = (np.linalg.pinv(pairs.reshape(-1, 3, 3), rcond=1e-9, hermitian=True) @ mean[:, :, None])[:, :, 0]
        share = self._share * (1.0 - np.einsum("nk,nk->n", away, turn[self._of]))
        missed = np.abs(total(share[:, None] * step)).max(axis=1, initial=0.0)
        good = (np.bincount(self._of, share < 0.0, count) == 0) & (missed < 1e-9)
        kept = good[self._of]
        self.node, self._cell, self._share = self.node[good], self._cell[kept], share[kept]
        self._of = (np.cumsum(good) - 1)[self._of[kept]]

    def average(self, value: np.ndarray, density: np.ndarray) -> None:
        """Set the densities of these nodes to the averages of `value`, one value for each cell."""
        if len(self.node):
            density[self.node] = np.bincount(self._of, self._share * value[self._cell], len(self.node))


def foremost(held: np.ndarray, shape) -> np.ndarray:
    """Return the nodes of the most upstream twentieth of the layers that the mesh covers."""
    inside = held.reshape(shape)
    layers = np.flatnonzero(inside.any(axis=(0, 1)))
    first = int(layers[int(0.95 * (len(layers) - 1))])
    across, layer = np.nonzero(inside.reshape(-1, shape[2])[:, first:])
    return np.asarray(across * shape[2] + first + layer)


class EmptyNodes:
    """Nodes in no cell, extrapolated layer by layer from the known nodes beside them; deeper ones are ambient.

    In the first layers the extrapolation is linear, by the lesser of two consecutive changes, so that a linear density
    stays linear and a shock is not carried on. In deeper layers it is constant.
    """

    def __init__(self, held: np.ndarray, shape):
        """Find the nodes, and the known nodes from which each is extrapolated."""
        from scipy.ndimage import binary_dilation

        known = held.copy()
        strides = (shape[1] * shape[2], shape[2], 1)
        self._layers: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []  # nodes, and rows of up to three known ones
        for depth in range(8):  # layers into which the density is extrapolated, in a body and beyond the mesh
            inside = known.reshape(shape)
            if inside.all():
                break
            empty = np.flatnonzero(binary_dilation(inside) & ~inside).astype(np.int32)
            if not len(empty):
                break
            place = np.unravel_index(empty, shape)
            rows, near = [], []
            for axis, stride in enumerate(strides):
                for side in (-1, 1):
                    room = place[axis] if side < 0 else shape[axis] - 1 - place[axis]
                    line = [empty + np.int32(side * stride * steps) for steps in (1, 2, 3)]
                    good = np.ones(len(empty), bool)
                    for steps, other in enumerate(line, start=1):
                        good &= room >= steps
                        good &= known[np.where(good, other, 0)]
                        # The first three layers are extrapolated linearly.
                        if depth >= 3 and steps > 1:
                            good[:] = False
                        other[~good] = -1
                    row = np.flatnonzero(line[0] >= 0)
                    rows.append(row)
                    near.append(np.stack([other[row] for other in line]))
            row, result = np.concatenate(rows), np.concatenate(near, axis=1)
            changes = result[1] >= 0
            some = np.bincount(row, changes, len(empty)) > 0
            of_use = changes | ~some[row]  # drop single known nodes where two in a row are known in another direction
            self._layers.append((empty, row[of_use], result[:, of_use]))
            known[empty] = True
        self._deep = np.flatnonzero(~known)

    def fill(self, density: np.ndarray, ambient: float) -> None:
        """Set the densities of these nodes."""
        density[self._deep] = ambient
        for node, row, near in self._layers:
            one, two, three = density[near]
            rise = np.where(near[1] >= 0, one - two, 0.0)
            rise = np.where(near[2] >= 0, lesser(rise, two - three), rise)
            total = np.bincount(row, np.maximum(one + rise, LEAST_SHARE * one), len(node))
            density[node] = total / np.bincount(row, minlength=len(node))
