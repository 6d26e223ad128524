r"""From averages over cells to values at the points of a mesh, exact for densities that are linear, up to its rim.

The value at a point is a mean of the averages of the cells about it, with weights >= 0 whose mean place is the point:
linear densities are kept, and no value leaves the range of these averages. A point on the rim of the mesh lies beyond
the middles of its cells. Its value is their mean plus what the density changes from there on. Two estimates say so: the
slope of the cells about it, and a line through the points further in; the lesser counts, and nothing where their signs
differ. A shock between the first and the second layer of cells is so not carried outward. Nor is anything where the
cells do not lie on a line: the change fades out where they miss it by 0.04 to 0.12 of what they differ. It is at most
the difference between the greatest and the least of those cells, and a tenth of the least of them remains.
"""

from dataclasses import dataclass

import numpy as np

from .rows import Rows

LEAST_SHARE = 0.1  # of the least average about a point on the rim, below which its value does not fall
FLAT = 1e-11  # of the greatest square: directions in which places differ less are without a slope
CHUNK = 20_000  # points on the rim at a time


@dataclass(frozen=True, eq=False)
class PointValues:
    """The map from averages over cells to values at points.

    Attributes:
        cells: Cells with flow about each point.
        weight: Their weights, shape (entry_count,).
        rim: Numbers of the points that lie beyond the middles of their cells, shape (m,).
        near: Cells about each of those, two deep.
        near_weight: Their weights in what is added to the mean of the first.
        near_basis: Directions of unit length in which these cells lie, shape (entry_count, 3): what their averages have
            along them is what a line explains of their squares.
        far: Points further in, whose values follow from their cells alone; none where they tell of no slope.
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
        """Work it out.

        Args:
            corners: Points of each cell.
            middle: Places of the averages [m], shape (cell_count, 3).
            points: [m], shape (point_count, 3).
            blank: Which cells have no flow, shape (cell_count,); None where all have.
        """
        from .mesh_kernels import launch
        from .point_kernels import convex_weights

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
        """Values at the points, shape (point_count,); 0 where no cell has flow."""
        from .mesh_kernels import launch
        from .point_kernels import carry_to_rim, weighted_means

        cells, value = self.cells, np.empty(len(self.cells.start) - 1)
        launch(weighted_means, len(value), cells.start, cells.column, self.weight, average, value)
        near, far = self.near, self.far
        launch(
            carry_to_rim, len(self.rim), self.rim, near.start, near.column, self.near_weight, self.near_basis,
            far.start, far.column, self.far_weight, LEAST_SHARE, average, value,
        )  # fmt: skip
        return value


def _turned(corners: Rows, point_count: int, blank: np.ndarray | None) -> Rows:
    """The cells at each point, those without flow left out."""
    from scipy.sparse import csr_array

    start, column = corners.start, corners.column
    if blank is not None:
        width = np.where(blank, 0, np.diff(start))
        keep = np.repeat(~blank, np.diff(start))
        start, column = np.concatenate([[0], np.cumsum(width)]), column[keep]
    # Transposing a sparse matrix sorts in one pass, which no sort of the numbers does.
    true = np.ones(len(column), bool)
    turned = csr_array((true, column, start), shape=(len(start) - 1, point_count)).tocsc()
    return Rows(turned.indptr.astype(np.int64), turned.indices.astype(np.int32, copy=False))


def _beyond(at_cells, at_points, middle, points, inside, rim):
    """Cells about some points on the rim and points further in, each with its weights.

    Args:
        at_cells: Which cells are at each point, a sparse matrix.
        at_points: Which points each cell has.
        middle: Of the cells [m].
        points: [m].
        inside: Which points lie between the middles of their cells.
        rim: The points that are asked for.
    """
    own = at_cells[rim]
    around = own @ at_points @ at_cells
    width = np.diff(own.indptr)
    first = np.add.reduceat(middle[own.indices], own.indptr[:-1], axis=0) / width[:, None]
    near = Rows.of_matrix(around)
    weight, rank, basis = _slope_along(near, middle, points[rim] - first)
    kept, far, far_weight = np.arange(len(rim)), [], []
    for _ in range(2):  # where the points of these cells lie in a plane, those of the cells about them
        inner = around @ at_points
        inner.data = inside[inner.indices]
        inner.eliminate_zeros()
        rows = Rows.of_matrix(inner)
        found, full = _values_at(rows, points, points[rim[kept]])
        good = full >= rank[kept]
        some, entry = rows.taken(np.flatnonzero(good))
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
        _, place = Rows(start, column).taken(row)
        column[place], together[place] = some.column, found
    return near, weight, basis, Rows(start, column), together


def _slope_along(rows: Rows, place: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights of what rows list in the change along a vector (n, 3) by the best slope, of one row after the other.

    And the number of directions that the slope has, and the places by directions of unit length, (entry_count, 3).
    """
    width, begin = np.diff(rows.start), rows.start[:-1]
    if not len(rows.column):
        return np.empty(0), np.zeros(len(width), int), np.empty((0, 3))
    some = width > 0  # sums over rows without entries would take their neighbours'

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
    found += weights(along - total(found[:, None] * step))  # what rounding left
    return found, good.sum(axis=1), basis


def _values_at(rows: Rows, place: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights of what rows list in the value at a place (n, 3) on the best line; and the line's directions."""
    width = np.diff(rows.start)
    mean = np.repeat(1.0 / np.maximum(width, 1), width)
    some, centre = width > 0, at.copy()
    if some.any():
        centre[some] = np.add.reduceat(place[rows.column], rows.start[:-1][some], axis=0) / width[some, None]
    found, rank, _ = _slope_along(rows, place, at - centre)
    return mean + found, rank


def _together(parts: list[tuple]) -> tuple:
    """Rows and arrays of their entries, one part after the other."""
    if not parts:
        return Rows(np.zeros(1, np.int64), np.empty(0, np.int32)), np.empty(0), np.empty((0, 3))
    start = np.concatenate([[0], *(np.diff(rows.start) for rows, *_ in parts)]).cumsum()
    column = np.concatenate([rows.column for rows, *_ in parts])
    return Rows(start, column), *(np.concatenate(each) for each in list(zip(*parts, strict=True))[1:])
