r"""Convert cell averages to values at the points of a mesh, exact for linear densities up to its rim.

The value at a point is a mean of the averages of the surrounding cells, with weights >= 0 for which the mean of the
centroids is the point: linear densities are kept, and no value leaves the range of these averages. A point on the rim
of the mesh is outside the centroids of its cells. Its value is their mean plus the change of the density from there to
the point. Two estimates of this change are made: by the slope of the surrounding cells, and by a line through the
points
further in. The lesser counts, and zero where their signs differ, so that a shock between the first and the second layer
of cells is not carried outward. Where the cells deviate from a line by 0.04 to 0.12 of their range the change fades
out. It is at most the range of those cells, and the value stays above a tenth of the least of them.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class Rows:
    """For each row a list of numbers: `column[start[row]:start[row + 1]]`.

    Attributes:
        start: int64, shape (row_count + 1,).
        column: int32.
    """

    start: np.ndarray
    column: np.ndarray

    @classmethod
    def sorted(cls, row: np.ndarray, column: np.ndarray, count: int) -> tuple["Rows", np.ndarray]:
        """Return pairs sorted by their rows, and the order that sorts them."""
        order = np.argsort(row, kind="stable")
        start = np.zeros(count + 1, np.int64)
        np.cumsum(np.bincount(row, minlength=count), out=start[1:])
        return cls(start, column[order].astype(np.int32)), order

    @classmethod
    def of_matrix(cls, matrix) -> "Rows":
        """Return the columns of the entries in each row of a sparse matrix, ascending."""
        matrix.sort_indices()
        return cls(matrix.indptr.astype(np.int64), matrix.indices.astype(np.int32, copy=False))

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
        begin, width = self.start[row], np.diff(self.start)[row]
        start = np.zeros(len(row) + 1, np.int64)
        np.cumsum(width, out=start[1:])
        entry = np.arange(start[-1]) + np.repeat(begin - start[:-1], width)
        return Rows(start, self.column[entry]), entry

    def means(self, values: np.ndarray) -> np.ndarray:
        """Return the mean of the values that each row lists, 0 for an empty row."""
        from aerokernels.flow.reading.volumes.mesh_kernels import launch, mean_of_listed

        result = np.empty(len(self.start) - 1)
        launch(mean_of_listed, len(result), self.start, self.column, np.ascontiguousarray(values), result)
        return result

    def signed_rms(self, each: np.ndarray) -> np.ndarray:
        """Return the root mean square of each row's entries, with the sign of their mean; no row may be empty."""
        if not len(each):
            return np.empty(0)
        begin = self.start[:-1]
        squares = np.add.reduceat(each**2, begin) / np.diff(self.start)
        return np.copysign(np.sqrt(squares), np.add.reduceat(each, begin))


LEAST_SHARE = 0.1  # of the least average around a point on the rim: lower bound of its value
FLAT = 1e-11  # of the greatest eigenvalue: directions with less spread of the places get no slope
CHUNK = 20_000  # points on the rim at a time


@dataclass(frozen=True, eq=False)
class PointValues:
    """The map from cell averages to values at points.

    Attributes:
        cells: Cells with flow around each point.
        weight: Their weights, shape (entry_count,).
        rim: Numbers of the points outside the centroids of their cells, shape (m,).
        near: Two layers of cells around each rim point.
        near_weight: Their weights in the change that is added to the mean of the first layer.
        near_basis: Orthonormal basis of the places of these cells, shape (entry_count, 3): the squared components of
            their averages in it are the part of the variance that a linear function explains.
        far: Points further in, whose values follow from their cells alone; none where they determine no slope.
        far_weight: Their weights, which add up to 1.
    """

    cells: Rows
    weight: np.ndarray
    rim: np.ndarray
    near: Rows
    near_weight: np.ndarray
    near_basis: np.ndarray
    far: Rows
    far_weight: np.ndarray

    @classmethod
    def of(cls, corners: Rows, middle: np.ndarray, points: np.ndarray, blank: np.ndarray | None) -> "PointValues":
        """Compute the map from the mesh.

        Args:
            corners: Points of each cell.
            middle: Centroids to which the averages belong [m], shape (cell_count, 3).
            points: [m], shape (point_count, 3).
            blank: Which cells have no flow, shape (cell_count,); None where all have.
        """
        from aerokernels.flow.reading.volumes.mesh_kernels import launch
        from aerokernels.flow.reading.volumes.point_kernels import convex_weights

        cells = _turned(corners, len(points), blank)
        weight, inside = np.empty(len(cells.column)), np.zeros(len(points), np.int32)
        points = np.ascontiguousarray(points)
        launch(convex_weights, len(points), cells.start, cells.column, middle, points, weight, inside)
        rim = np.flatnonzero((inside == 0) & (np.diff(cells.start) > 0)).astype(np.int32)
        at_cells, at_points = cells.matrix(len(middle)), corners.matrix(len(points))
        parts = [
            _beyond(at_cells, at_points, middle, points, inside > 0, rim[first : first + CHUNK])
            for first in range(0, len(rim), CHUNK)
        ]
        near, near_weight, near_basis = _together([part[:3] for part in parts])
        far, far_weight = _together([part[3:] for part in parts])[:2]
        return cls(cells, weight, rim, near, near_weight, near_basis, far, far_weight)

    def values(self, average: np.ndarray) -> np.ndarray:
        """Return values at the points, shape (point_count,); 0 where no cell has flow."""
        from aerokernels.flow.reading.volumes.mesh_kernels import launch
        from aerokernels.flow.reading.volumes.point_kernels import carry_to_rim, weighted_means

        cells, value = self.cells, np.empty(len(self.cells.start) - 1)
        launch(weighted_means, len(value), cells.start, cells.column, self.weight, average, value)
        near, far = self.near, self.far
        launch(
            carry_to_rim, len(self.rim), self.rim, near.start, near.column, self.near_weight, self.near_basis,
            far.start, far.column, self.far_weight, LEAST_SHARE, average, value,
        )  # fmt: skip
        return value


def _turned(corners: Rows, point_count: int, blank: np.ndarray | None) -> Rows:
    """Return the cells at each point, without those that have no flow."""
    if blank is not None:
        width = np.diff(corners.start)
        start = np.concatenate([[0], np.cumsum(np.where(blank, 0, width))])
        corners = Rows(start, corners.column[np.repeat(~blank, width)])
    return corners.transposed(point_count)


def _beyond(at_cells, at_points, middle, points, inside, rim):
    """Return the cells around some rim points and the points further in, each with its weights."""
    own = at_cells[rim]
    around = own @ at_points @ at_cells
    width = np.diff(own.indptr)
    first = np.add.reduceat(middle[own.indices], own.indptr[:-1], axis=0) / width[:, None]
    near = Rows.of_matrix(around)
    weight, rank, basis = _slope_along(near, middle, points[rim] - first)
    kept, far, far_weight = np.arange(len(rim)), [], []
    for _ in range(2):  # if the points of these cells are in a plane, add those of the next layer of cells
        inner = around @ at_points
        inner.data = inside[inner.indices]
        inner.eliminate_zeros()
        rows = Rows.of_matrix(inner)
        found, full = _values_at(rows, points, points[rim[kept]])
        good = full >= rank[kept]
        some, entry = rows.select(np.flatnonzero(good))
        far.append((kept[good], some))
        far_weight.append(found[entry])
        kept, around = kept[~good], around[~good]
        if not len(kept):
            break
        around = around @ at_points @ at_cells
    width = np.zeros(len(rim), np.int64)
    for row, some in far:
        width[row] = np.diff(some.start)
    start = np.concatenate([[0], np.cumsum(width)])
    column, together = np.empty(start[-1], np.int32), np.empty(start[-1])
    for (row, some), found in zip(far, far_weight, strict=True):
        _, place = Rows(start, column).select(row)
        column[place], together[place] = some.column, found
    return near, weight, basis, Rows(start, column), together


def _slope_along(rows: Rows, place: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return each row's weights in the change along a vector (n, 3) by the least-squares slope, row after row.

    Also the number of directions in which the slope is determined, and the places in an orthonormal basis,
    (entry_count, 3).
    """
    width, begin = np.diff(rows.start), rows.start[:-1]
    if not len(rows.column):
        return np.empty(0), np.zeros(len(width), int), np.empty((0, 3))
    some = width > 0  # reduceat over an empty row would return its neighbour's entry

    def total(each: np.ndarray) -> np.ndarray:
        found = np.zeros((len(width), *each.shape[1:]))
        found[some] = np.add.reduceat(each, begin[some], axis=0)
        return found

    at = place[rows.column]
    step = at - np.repeat(total(at) / np.maximum(width, 1)[:, None], width, axis=0)
    values, vectors = np.linalg.eigh(total(step[:, :, None] * step[:, None, :]))
    good = values > FLAT * values[:, 2:]
    unit = np.where(good, 1.0, 0.0) / np.sqrt(np.where(good, values, 1.0))
    turned = vectors * unit[:, None]
    basis = np.einsum("nk,nki->ni", step, np.repeat(turned, width, axis=0))

    def weights(rise: np.ndarray) -> np.ndarray:
        own = np.einsum("nki,nk->ni", turned, rise)
        return np.asarray(np.einsum("ni,ni->n", basis, np.repeat(own, width, axis=0)))

    found = weights(along)
    found += weights(along - total(found[:, None] * step))  # correct for rounding
    return found, good.sum(axis=1), basis


def _values_at(rows: Rows, place: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return each row's weights in the value of the least-squares line at a place (n, 3), and the line's rank."""
    width = np.diff(rows.start)
    mean = np.repeat(1.0 / np.maximum(width, 1), width)
    some, centre = width > 0, at.copy()
    if some.any():
        centre[some] = np.add.reduceat(place[rows.column], rows.start[:-1][some], axis=0) / width[some, None]
    found, rank, _ = _slope_along(rows, place, at - centre)
    return mean + found, rank


def _together(parts: list[tuple]) -> tuple:
    """Concatenate rows and the arrays of their entries."""
    if not parts:
        return Rows(np.zeros(1, np.int64), np.empty(0, np.int32)), np.empty(0), np.empty((0, 3))
    start = np.concatenate([[0], *(np.diff(rows.start) for rows, *_ in parts)]).cumsum()
    column = np.concatenate([rows.column for rows, *_ in parts])
    return Rows(start, column), *(np.concatenate(each) for each in list(zip(*parts, strict=True))[1:])


@dataclass(frozen=True, eq=False)
class PointDeficits:
    """The geometry for estimating what linear functions between point values lack in a curved density.

    The slope at a point is the mean of the slopes of the cells around it. From a corner p of a cell with the slope
    s, the density at the mean m of its corners is f(p) + (m - p) . (g(p) + s) / 2, to the third order of the cell's
    size, where the function of the cell has f(p) + (m - p) . s. The difference is alike from every corner where the
    density is curved, and changes sign from one side of a captured shock to the other: its root mean square counts,
    with the sign of its mean. The result is twice the deficit, as `Linear.deficit` is where averages are given.

    Attributes:
        around: Points of the cells around the corners of these cells, one row for each such cell.
        weight: Weights of those points in the slope of their cell, shape (entry_count, 3).
        middle: Mean of the points of each cell of `around` [m].
        own: Row in `around` of each estimated cell.
        to_points: The mean over the cells around each corner, a sparse matrix.
        corners: The corners of each estimated cell, as rows of `to_points`.
        step: From each corner to the mean of the corners [m], shape (entry_count, 3).
    """

    around: Rows
    weight: np.ndarray
    middle: np.ndarray
    own: np.ndarray
    to_points: Any
    corners: Rows
    step: np.ndarray

    @classmethod
    def of(cls, rows: Rows, weight: np.ndarray, centre: np.ndarray, points: np.ndarray, cell: np.ndarray):
        """Prepare the estimate for some cells of a block.

        Args:
            rows: The points of every cell.
            weight: Their weights in the slope of the cell, shape (entry_count, 3).
            centre: The mean of the points of every cell [m].
            points: [m], shape (point_count, 3).
            cell: Numbers of the cells to estimate.
        """
        from scipy.sparse import csr_array

        own, _ = rows.select(cell)
        corner, local = np.unique(own.column, return_inverse=True)
        number = np.full(len(points), -1, np.int32)
        number[corner] = np.arange(len(corner))
        entry = np.flatnonzero(number[rows.column] >= 0)
        near = np.unique(np.searchsorted(rows.start, entry, "right") - 1)
        around, entry = rows.select(near)
        some = number[around.column] >= 0
        of = np.repeat(np.arange(len(near)), np.diff(around.start))[some]
        at = number[around.column[some]]
        share = 1.0 / np.bincount(at, minlength=len(corner))
        mean = csr_array((share[at], (at, of)), shape=(len(corner), len(near)))
        step = np.repeat(centre[cell], np.diff(own.start), axis=0) - points[own.column]
        corners = Rows(own.start, local.astype(np.int32))
        return cls(around, weight[entry], centre[near], np.searchsorted(near, cell), mean, corners, step)

    def deficit(self, value: np.ndarray) -> np.ndarray:
        """Return twice the deficit of each cell's function at the mean of its corners, from values at all points."""
        from aerokernels.flow.reading.volumes.mesh_kernels import launch, linear_functions

        count = len(self.middle)
        function = np.empty((count, 6))
        launch(
            linear_functions, count, self.around.start, self.around.column, self.weight, value,
            self.around.means(value), self.middle, (0.0, 0.0, 0.0), function,
        )  # fmt: skip
        slope = function[:, 1:4]
        own = np.repeat(slope[self.own], np.diff(self.corners.start), axis=0)
        differ = own - (self.to_points @ slope)[self.corners.column]
        return self.corners.signed_rms(np.einsum("nk,nk->n", differ, self.step))
