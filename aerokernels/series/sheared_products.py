r"""Sums along the lines through the nodes of a volume, on the processor: products of matrices, and shifts.

Along the lines of sheared_lattice.py the node at offset (du, dv) from a line's own node contributes in plane k with a
weight C[(du, dv), k] that is the same for all lines:

    g(u, v) = sum over (du, dv) of  P[(du, dv)](u + du, v + dv),      P = C f,   f(k, node) = samples - offset

C is computed once for a direction. P is a matrix product, at the speed of the BLAS library, which reads the samples in
place, some rows at a time; the sum of the shifted P runs along rows. The planes are divided into the number of parts
that minimises the work: the lines drift, so fewer planes together have fewer offsets.
"""

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np

from ..process.machine import core_count

BEYOND = 3  # cells beyond an edge to which samples are extrapolated, by the cubic through the last four
DIVISIONS = (1, 2, 3, 4, 6, 8)  # of the planes; speed only
SHIFT_COST = 50.0  # cost of shifting a value of P, in multiplications of its product; speed only
AT_ONCE = 1_000_000  # samples at a time; speed only
ON = np.array([[4.0, -6.0, 4.0, -1.0], [10.0, -20.0, 15.0, -4.0], [20.0, -45.0, 36.0, -10.0]])  # 1, 2, 3 cells beyond


class ShearedProducts:
    """The map from samples to sums along lines through the nodes."""

    def __init__(self, axis: int, counts, shift: np.ndarray, blends, weights: np.ndarray, low, size):
        """Prepare the part that depends on the direction.

        Args:
            axis: The array axis across the planes.
            counts: Nodes along the other two axes, four or more.
            shift: First node's offset from the line's own node in each plane, shape (plane_count, 2).
            blends: Weights of the nodes from there on along each axis, shapes (plane_count, taps).
            weights: Of the planes, shape (plane_count,).
            low: Node of the first line along each axis; it may be outside.
            size: Lines along each axis.
        """
        self._axis, self._counts, self._low, self._size = axis, counts, low, size
        found = [_parts(shift, blends, weights, count) for count in DIVISIONS if count <= len(weights)]
        self._parts = min(found, key=_cost)
        offsets = np.concatenate([offset for _, offset, _ in self._parts])
        first = np.clip(low + offsets.min(axis=0), -BEYOND, np.add(counts, BEYOND - 1))
        last = np.clip(low + size - 1 + offsets.max(axis=0), -BEYOND, np.add(counts, BEYOND - 1))
        self._first, self._stop = first, last + 1  # range of the nodes that are needed, along each axis
        self._drift = int(offsets[:, 0].min()), int(offsets[:, 0].max())
        self._matrices: dict[np.dtype, list[np.ndarray]] = {}

    def __call__(self, samples: np.ndarray, offset: float) -> np.ndarray:
        """Return sums of samples minus a constant, shape `size`, in the samples' precision."""
        if samples.dtype not in self._matrices:
            self._matrices[samples.dtype] = [part[2].astype(samples.dtype) for part in self._parts]
        first, stop, count = int(self._first[0]), int(self._stop[0]), self._counts[0]
        rows = max(8, AT_ONCE // (int(self._stop[1] - self._first[1]) * samples.shape[self._axis]))
        edges = {first, stop, 0, count, *range(max(first, 0), min(stop, count), rows)}
        bounds = sorted(edge for edge in edges if first <= edge <= stop)
        moved = np.moveaxis(samples, self._axis, 2 if self._axis == 2 else 0)

        def summed(rows: tuple[int, int]) -> tuple[int, np.ndarray]:
            return self._summed(moved, *rows, offset)

        total = np.zeros(self._size, samples.dtype)
        blocks = list(pairwise(bounds))
        with ThreadPoolExecutor(max(1, min(core_count(), len(blocks)))) as pool:
            for line, part in pool.map(summed, blocks):  # in a fixed order, so that results are reproducible
                total[line : line + len(part)] += part
        return total

    def _summed(self, moved: np.ndarray, begin: int, end: int, offset: float) -> tuple[int, np.ndarray]:
        """Return the contribution of some rows of nodes to the lines that pass them: the first line, and the sums."""
        drift = self._drift
        lines = max(begin - self._low[0] - drift[1], 0), min(end - self._low[0] - drift[0], self._size[0])
        if begin < 0:  # lines further out use the last of these rows
            lines = 0, lines[1]
        if end > self._counts[0]:
            lines = lines[0], int(self._size[0])
        total = np.zeros((max(lines[1] - lines[0], 0), self._size[1]), moved.dtype)
        block = self._block(moved, begin, end, offset)
        for (planes, offsets, _), matrix in zip(self._parts, self._matrices[moved.dtype], strict=True):
            # Row by row: BLAS computes such small products in one thread, without waiting for others.
            product = np.matmul(matrix, block[:, planes])
            for number, (du, dv) in enumerate(offsets.tolist()):
                low = self._low[0] + lines[0] + du, self._low[1] + dv
                some, rows = _lines_at(int(low[0]), len(total), self._counts[0], begin, end)
                _, columns = _lines_at(
                    int(low[1]), int(self._size[1]), self._counts[1], int(self._first[1]), int(self._stop[1])
                )
                if some.stop > some.start:
                    total[some] += product[rows, number][:, columns]
        return lines[0], total

    def _block(self, moved: np.ndarray, begin: int, end: int, offset: float) -> np.ndarray:
        """Return some rows of the samples minus the constant, shape (rows, planes, nodes of a row).

        Rows and ends of rows beyond the volume are extrapolated by the cubics through the last nodes.
        """
        at = 0 if self._axis == 2 else 1  # the axis of rows; that of a row's nodes is the next one
        count, width = self._counts
        inside = slice(begin, end) if 0 <= begin and end <= count else slice(0, 4) if begin < 0 else slice(-4, None)
        drawn_out = self._first[1] < 0 or self._stop[1] > width
        across = slice(0, width) if drawn_out else slice(int(self._first[1]), int(self._stop[1]))
        chosen = (*[slice(None)] * at, inside, across)
        block = np.subtract(moved[chosen], moved.dtype.type(offset), order="C")
        if not (0 <= begin and end <= count):
            numbers = -1 - np.arange(begin, end) if begin < 0 else np.arange(begin, end) - count
            block = _beyond(block, at, numbers, begin < 0)
        if drawn_out:
            block = self._widened(block, at + 1)
        return block.transpose((0, 2, 1) if self._axis == 2 else (1, 0, 2))

    def _widened(self, block: np.ndarray, axis: int) -> np.ndarray:
        """Cut or extend whole rows to the nodes that are needed."""
        count, first, stop = self._counts[1], int(self._first[1]), int(self._stop[1])
        parts = []
        if first < 0:
            numbers = -1 - np.arange(first, min(stop, 0))
            parts.append(_beyond(np.take(block, range(4), axis), axis, numbers, True))
        if first < count and stop > 0:
            parts.append(np.take(block, range(max(first, 0), min(stop, count)), axis))
        if stop > count:
            numbers = np.arange(max(first, count), stop) - count
            parts.append(_beyond(np.take(block, range(count - 4, count), axis), axis, numbers, False))
        return np.concatenate(parts, axis=axis)


def _lines_at(first: int, size: int, count: int, begin: int, end: int) -> tuple[slice, Any]:
    """Return which of `size` lines at the nodes from `first` meet the nodes from `begin` to `end`, and where.

    A line further beyond the edge than the extrapolated samples uses the last one.
    """
    least, most = -BEYOND, count + BEYOND - 1
    if least < begin and end <= most:  # neither end is among them: a contiguous run of nodes
        start, stop = max(begin - first, 0), min(end - first, size)
        return slice(start, max(stop, start)), slice(first + start - begin, first + max(stop, start) - begin)
    nodes = np.clip(np.arange(first, first + size), least, most)
    start, stop = np.searchsorted(nodes, (begin, end))
    return slice(int(start), int(stop)), nodes[start:stop] - begin


def _beyond(last: np.ndarray, axis: int, numbers: np.ndarray, before: bool) -> np.ndarray:
    """Return values beyond an end of an axis, from the last four; `numbers` 0, 1, 2: one, two, three cells beyond."""
    weights = ON[numbers] if before else ON[numbers][:, ::-1]
    return np.moveaxis(np.tensordot(weights.astype(last.dtype), last, (1, axis)), 0, axis)


def _parts(shift: np.ndarray, blends, weights: np.ndarray, count: int) -> list[tuple[slice, np.ndarray, np.ndarray]]:
    """Return planes, offsets (m, 2) and weights (m, planes) of each part."""
    bounds = np.linspace(0, len(weights), count + 1).round().astype(int)
    found = []
    for begin, end in pairwise(bounds):
        planes = slice(int(begin), int(end))
        along = [shift[planes, a, None] + np.arange(blends[a].shape[1]) for a in range(2)]
        pairs = np.stack(np.broadcast_arrays(along[0][:, :, None], along[1][:, None, :]), axis=-1)
        share = blends[0][planes][:, :, None] * blends[1][planes][:, None, :] * weights[planes, None, None]
        offsets, which = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
        matrix = np.zeros((len(offsets), end - begin))
        plane = np.repeat(np.arange(end - begin), share[0].size)
        np.add.at(matrix, (which.ravel(), plane), share.ravel())
        found.append((planes, offsets, matrix))
    return found


def _cost(parts: list[tuple[slice, np.ndarray, np.ndarray]]) -> float:
    return sum(len(matrix) * (matrix.shape[1] + SHIFT_COST) for _, _, matrix in parts)
