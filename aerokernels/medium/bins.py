"""Boxes in a plane, found by uniform bins: each bin lists the boxes that touch it."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

PAIRS = 1 << 17  # pairs of a point and a box that are tested together, which limits the size of arrays


@dataclass(frozen=True, eq=False)
class Bins:
    """Uniform bins over boxes in a plane: bin (i, j) lists `cell[start[k]:start[k + 1]]` with k = i * count[1] + j.

    `low` and `high` have the corners of the boxes, shape (2, box_count) each; `size` is that of a bin.
    """

    low: np.ndarray
    high: np.ndarray
    origin: np.ndarray
    size: np.ndarray
    count: tuple[int, int]
    start: np.ndarray
    cell: np.ndarray

    def pairs(self, points: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield all pairs of a point's index and a box that contains it, for some points at a time; boxes ascend."""
        within = (points >= self.low.min(axis=1)) & (points <= self.high.max(axis=1))
        rows = np.flatnonzero(within.all(axis=1))
        place = np.floor((points[rows] - self.origin) / self.size).astype(np.int64)
        place = np.clip(place, 0, np.array(self.count) - 1)
        key = place[:, 0] * self.count[1] + place[:, 1]
        listed = (self.start[key + 1] - self.start[key]).astype(np.int64)
        ends = np.cumsum(listed)
        first = 0
        while first < len(rows):
            before = ends[first - 1] if first else 0
            last = max(first + 1, int(np.searchsorted(ends, PAIRS + before, "right")))
            start, count = self.start[key[first:last]], listed[first:last]
            row = np.repeat(rows[first:last], count)
            before = np.cumsum(count) - count
            cell = self.cell[np.arange(len(row)) - np.repeat(before - start, count)]
            for axis in (0, 1):
                at = points[row, axis]
                near = np.flatnonzero((at >= self.low[axis][cell]) & (at <= self.high[axis][cell]))
                row, cell = row[near], cell[near]
            yield row, cell
            first = last


def bins_of(low: np.ndarray, high: np.ndarray, origin: np.ndarray, extent: np.ndarray) -> Bins:
    """Return about as many bins as there are boxes, over a rectangle from `origin` of a size `extent`."""
    from scipy.sparse import coo_matrix

    box_count = low.shape[1]
    extent = np.maximum(extent, 1e-300)
    count = np.minimum(np.maximum(1, np.sqrt(box_count * extent / extent[::-1]).astype(int)), 4096)
    size = extent / count
    first, last = (
        np.clip(((end - origin[:, None]) / size[:, None]).astype(np.int32), 0, count[:, None].astype(np.int32) - 1)
        for end in (low, high)
    )
    rows, columns = last - first + 1
    cell = np.repeat(np.arange(box_count, dtype=np.int32), rows * columns)
    within = np.arange(len(cell), dtype=np.int32) - np.repeat(
        np.cumsum(rows * columns, dtype=np.int32) - rows * columns, rows * columns
    )
    key = (first[0, cell] + within // columns[cell]) * np.int32(count[1]) + first[1, cell] + within % columns[cell]
    # A sparse matrix of bins and boxes sorts by counting.
    by_bin = coo_matrix((np.ones(len(key), np.int8), (key, cell)), shape=(int(count.prod()), box_count)).tocsr()
    start, listed = by_bin.indptr.astype(np.int32), by_bin.indices.astype(np.int32)
    return Bins(low, high, origin, size, (int(count[0]), int(count[1])), start, listed)
