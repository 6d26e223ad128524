r"""Convert cell averages to values at the points of a mesh, exact for linear densities up to its rim.

The value at a point is a mean of the averages of the surrounding cells, with weights >= 0 for which the mean of the
centroids is the point. A point on the rim is outside the centroids of its cells: it adds the change of the density from
their mean to the point, the lesser of two estimates (the slope of the surrounding cells, and a line through the points
further in), and zero where their signs differ, so that a shock is not carried outward. Where the cells deviate from a
line by 0.04 to 0.12 of their range the change fades out.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from aerokernels.flow.reading.dataset import entries_of, starts_of

LEAST_SHARE = 0.1  # of the least average around a point on the rim: lower bound of its value


def lesser(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the lesser of two changes, zero where they differ in sign."""
    return np.where(one * other > 0.0, np.sign(one) * np.minimum(np.abs(one), np.abs(other)), 0.0)


@dataclass(frozen=True, eq=False)
class Rows:
    """For each row a list of numbers: `column[start[row]:start[row + 1]]`."""

    start: np.ndarray  # int64, shape (row_count + 1,)
    column: np.ndarray  # int32

    @classmethod
    def of_matrix(cls, matrix) -> "Rows":
        """Return the columns of the entries in each row of a sparse matrix, ascending."""
        matrix.sort_indices()
        return cls(matrix.indptr.astype(np.int64), matrix.indices.astype(np.int32, copy=False))

    @property
    def width(self) -> np.ndarray:
        """Number of entries of each row."""
        return np.diff(self.start)

    def matrix(self, width: int):
        """Return a sparse boolean matrix with these entries and `width` columns."""
        from scipy.sparse import csr_array

        true = np.ones(len(self.column), bool)
        return csr_array((true, self.column, self.start), shape=(len(self.start) - 1, width))

    def transposed(self, width: int) -> "Rows":
        """Return for each of `width` columns the rows that list it, ascending."""
        # Transposing a sparse matrix sorts in one pass, faster than a sort of the numbers.
        turned = self.matrix(width).tocsc()
        return Rows(turned.indptr.astype(np.int64), turned.indices.astype(np.int32, copy=False))

    def select(self, row: np.ndarray) -> tuple["Rows", np.ndarray]:
        """Return some of the rows in a given order, and the positions of their entries in `column`."""
        entry = entries_of(self.start[row], self.width[row])
        return Rows(starts_of(self.width[row]), self.column[entry]), entry

    def spread(self, each: np.ndarray) -> np.ndarray:
        """Return the value of its row for each entry."""
        return np.repeat(each, self.width, axis=0)

    def totals(self, each: np.ndarray) -> np.ndarray:
        """Return the sum over each row of one value an entry, 0 for an empty row."""
        result = np.zeros((len(self.start) - 1, *each.shape[1:]))
        some = self.width > 0  # reduceat over an empty row would return its neighbour's entry
        if some.any():
            result[some] = np.add.reduceat(each, self.start[:-1][some], axis=0)
        return result

    def means(self, values: np.ndarray) -> np.ndarray:
        """Return the mean of the values that each row lists, 0 for an empty row."""
        total = self.totals(values[self.column])
        return total / np.maximum(self.width, 1).reshape(-1, *[1] * (total.ndim - 1))

    def ranges(self, values: np.ndarray, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the least and the greatest of each row's own value and those it lists; no row may be empty."""
        if not len(own):
            return own, own
        each, begin = values[self.column], self.start[:-1]
        return np.minimum(own, np.minimum.reduceat(each, begin)), np.maximum(own, np.maximum.reduceat(each, begin))

    def slopes(self, weight: np.ndarray, values: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Return weighted sums of the differences of the listed values from each row's own value, shape (n, 3)."""
        return self.totals((values[self.column] - self.spread(own))[:, None] * weight)

    def signed_rms(self, each: np.ndarray) -> np.ndarray:
        """Return the root mean square of each row's entries, with the sign of their mean; no row may be empty."""
        return np.copysign(np.sqrt(self.totals(each**2) / self.width), self.totals(each))


@dataclass(frozen=True, eq=False)
class PointValues:
    """The map from cell averages to values at points."""

    cells: Rows  # cells with flow around each point
    weight: np.ndarray  # their weights, shape (entry_count,)
    rim: np.ndarray  # numbers of the points outside the centroids of their cells, shape (m,)
    near: Rows  # two layers of cells around each rim point
    near_weight: np.ndarray  # their weights in the change that is added to the mean of the first layer
    # Orthonormal basis of the places of these cells, shape (entry_count, 3): the squared components of their averages
    # in it are the part of the variance that a linear function explains.
    near_basis: np.ndarray
    far: Rows  # points further in, whose values follow from their cells alone; none where they determine no slope
    far_weight: np.ndarray  # their weights, which add up to 1

    @classmethod
    def of(cls, corners: Rows, middle: np.ndarray, points: np.ndarray, blank: np.ndarray | None) -> "PointValues":
        """Compute the map from the points of each cell, the cells' centroids, all points [m] and cells without flow."""
        from aerokernels.flow.reading.volumes.mesh_kernels import convex_weights, launch

        kept = corners
        if blank is not None:
            kept = Rows(starts_of(np.where(blank, 0, corners.width)), corners.column[corners.spread(~blank)])
        cells = kept.transposed(len(points))
        weight, inside = np.empty(len(cells.column)), np.zeros(len(points), np.int32)
        points = np.ascontiguousarray(points)
        launch(convex_weights, len(points), cells.start, cells.column, middle, points, weight, inside)
        rim = np.flatnonzero((inside == 0) & (cells.width > 0)).astype(np.int32)
        at_cells, at_points = cells.matrix(len(middle)), corners.matrix(len(points))
        chunk = 20_000  # points at a time: bounds the memory
        parts = [
            _beyond(at_cells, at_points, middle, points, inside > 0, rim[first : first + chunk])
            for first in range(0, len(rim), chunk)
        ]
        near, near_weight, near_basis = _together([part[:3] for part in parts])
        far, far_weight = _together([part[3:] for part in parts])[:2]
        return cls(cells, weight, rim, near, near_weight, near_basis, far, far_weight)

    def values(self, average: np.ndarray) -> np.ndarray:
        """Return values at the points, shape (point_count,); 0 where no cell has flow."""
        value = self.cells.totals(self.weight * average[self.cells.column])
        near, far, own = self.near, self.far, value[self.rim]
        change = average[near.column] - near.spread(own)
        low, high = near.ranges(average, own)
        # The root mean square deviation of the cells from their best linear fit, over their range.
        explained = (near.totals(change[:, None] * self.near_basis) ** 2).sum(axis=1)
        left = np.maximum(near.totals(change**2) - near.totals(change) ** 2 / near.width - explained, 0.0)
        missed = np.sqrt(left / near.width) / np.maximum(high - low, 1e-300)
        share = np.clip((0.12 - missed) / (0.12 - 0.04), 0.0, 1.0)
        further = far.totals(self.far_weight * (value[far.column] - far.spread(own)))
        rise = np.clip(share * lesser(near.totals(self.near_weight * change), further), low - high, high - low)
        value[self.rim] = np.maximum(own + rise, np.minimum(own, LEAST_SHARE * low))
        return value


def _beyond(at_cells, at_points, middle, points, inside, rim):
    """Return the cells around some rim points and the points further in, each with its weights."""
    own = at_cells[rim]
    around = own @ at_points @ at_cells
    first = Rows(own.indptr.astype(np.int64), own.indices).means(middle)
    near = Rows.of_matrix(around)
    weight, rank, basis = _slope_along(near, middle, points[rim] - first)
    kept, far, far_weight = np.arange(len(rim)), [], []
    for _ in range(2):  # if the points of these cells are in a plane, add those of the next layer of cells
        inner = around @ at_points
        inner.data = inside[inner.indices]
        inner.eliminate_zeros()
        rows = Rows.of_matrix(inner)
        at = points[rim[kept]]  # the value of the least-squares line there
        centre = np.where(rows.width[:, None] > 0, rows.means(points), at)
        slope, full, _ = _slope_along(rows, points, at - centre)
        result = rows.spread(1.0 / np.maximum(rows.width, 1)) + slope
        good = full >= rank[kept]
        some, entry = rows.select(np.flatnonzero(good))
        far.append((kept[good], some))
        far_weight.append(result[entry])
        kept, around = kept[~good], around[~good]
        if not len(kept):
            break
        around = around @ at_points @ at_cells
    width = np.zeros(len(rim), np.int64)
    for row, some in far:
        width[row] = some.width
    start = starts_of(width)
    column, together = np.empty(start[-1], np.int32), np.empty(start[-1])
    for (row, some), result in zip(far, far_weight, strict=True):
        _, place = Rows(start, column).select(row)
        column[place], together[place] = some.column, result
    return near, weight, basis, Rows(start, column), together


def _slope_along(rows: Rows, place: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return each row's weights in the change along a vector (n, 3) by the least-squares slope, row after row.

    Also the number of directions in which the slope is determined, and the places in an orthonormal basis.
    """
    if not len(rows.column):
        return np.empty(0), np.zeros(len(rows.width), int), np.empty((0, 3))
    step = place[rows.column] - rows.spread(rows.means(place))
    values, vectors = np.linalg.eigh(rows.totals(step[:, :, None] * step[:, None, :]))
    good = values > 1e-11 * values[:, 2:]  # directions with less spread of the places get no slope
    unit = np.where(good, 1.0, 0.0) / np.sqrt(np.where(good, values, 1.0))
    turned = vectors * unit[:, None]
    basis = np.einsum("nk,nki->ni", step, rows.spread(turned))

    def weights(rise: np.ndarray) -> np.ndarray:
        return np.asarray(np.einsum("ni,ni->n", basis, rows.spread(np.einsum("nki,nk->ni", turned, rise))))

    result = weights(along)
    result += weights(along - rows.totals(result[:, None] * step))  # correct for rounding
    return result, good.sum(axis=1), basis


def _together(parts: list[tuple]) -> tuple:
    """Concatenate rows and the arrays of their entries."""
    if not parts:
        return Rows(np.zeros(1, np.int64), np.empty(0, np.int32)), np.empty(0), np.empty((0, 3))
    column = np.concatenate([rows.column for rows, *_ in parts])
    return Rows(starts_of(np.concatenate([rows.width for rows, *_ in parts])), column), *(
        np.concatenate(each) for each in list(zip(*parts, strict=True))[1:]
    )


@dataclass(frozen=True, eq=False)
class PointDeficits:
    """The geometry for estimating what linear functions between point values lack in a curved density.

    The slope at a point is the mean of the slopes of the cells around it. From a corner p of a cell with the slope
    s, the density at the mean m of its corners is f(p) + (m - p) . (g(p) + s) / 2, to the third order of the cell's
    size, where the function of the cell has f(p) + (m - p) . s. The difference is alike from every corner where the
    density is curved, and changes sign from one side of a captured shock to the other: its root mean square counts,
    with the sign of its mean. The result is twice the deficit, as that of `CrossedCells` is where averages are given.
    """

    around: Rows  # points of the cells around the corners of these cells, one row for each such cell
    weight: np.ndarray  # weights of those points in the slope of their cell, shape (entry_count, 3)
    own: np.ndarray  # row in `around` of each estimated cell
    to_points: Any  # the mean over the cells around each corner, a sparse matrix
    corners: Rows  # the corners of each estimated cell, as rows of `to_points`
    step: np.ndarray  # from each corner to the mean of the corners [m], shape (entry_count, 3)

    @classmethod
    def of(cls, rows: Rows, weight: np.ndarray, centre: np.ndarray, points: np.ndarray, cell: np.ndarray):
        """Prepare some cells of a block, of whose every cell are given the points, their weights and their mean [m]."""
        from scipy.sparse import csr_array

        own, _ = rows.select(cell)
        corner, local = np.unique(own.column, return_inverse=True)
        number = np.full(len(points), -1, np.int32)
        number[corner] = np.arange(len(corner))
        entry = np.flatnonzero(number[rows.column] >= 0)
        near = np.unique(np.searchsorted(rows.start, entry, "right") - 1)
        around, entry = rows.select(near)
        some = number[around.column] >= 0
        of = around.spread(np.arange(len(near)))[some]
        at = number[around.column[some]]
        share = 1.0 / np.bincount(at, minlength=len(corner))
        mean = csr_array((share[at], (at, of)), shape=(len(corner), len(near)))
        step = own.spread(centre[cell]) - points[own.column]
        return cls(
            around, weight[entry], np.searchsorted(near, cell), mean, Rows(own.start, local.astype(np.int32)), step
        )

    def deficit(self, value: np.ndarray) -> np.ndarray:
        """Return twice the deficit of each cell's function at the mean of its corners, from values at all points."""
        slope = self.around.slopes(self.weight, value, self.around.means(value))
        differ = self.corners.spread(slope[self.own]) - (self.to_points @ slope)[self.corners.column]
        return self.corners.signed_rms(np.einsum("nk,nk->n", differ, self.step))
