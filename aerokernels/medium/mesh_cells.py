"""The cells of a quadrilateral mesh: bilinear map, orientation, faults, and the cells across their edges."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

# Relative tolerance of the containment test, so that a point on an edge belongs to at least one of the two cells.
EDGE_TOLERANCE = 1e-9
# Cells that are examined together, which limits the size of arrays.
PART = 1 << 17  # speed only


def cells_across(cells: np.ndarray, vertex_count: int) -> np.ndarray:
    """Return the cell across each edge of quadrilaterals (n, 4), -1 at the boundary, shape (n, 4): see `neighbors`."""
    edge = np.sort(np.stack([cells, np.roll(cells, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    key = edge[:, 0].astype(np.int64) * vertex_count + edge[:, 1]
    order = np.argsort(key, kind="stable")
    pair = np.flatnonzero(key[order][1:] == key[order][:-1])
    result = np.full(len(key), -1, dtype=np.int32)
    result[order[pair]] = order[pair + 1] // 4
    result[order[pair + 1]] = order[pair] // 4
    return result.reshape(-1, 4)


def check_duplicates(vertices: np.ndarray) -> None:
    """Reject two vertices in one place: cells on either side would look like neighbours without being connected."""
    _, first, inverse = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    if len(first) == len(vertices):
        return
    original = first[inverse.ravel()]
    duplicate = np.flatnonzero(original != np.arange(len(vertices)))
    worst = duplicate[0]
    raise ValueError(
        f"{len(duplicate)} vertices lie in the same place as another, the first are vertices {original[worst]} and "
        f"{worst} at {vertices[worst].tolist()}: merge duplicate nodes"
    )


def _faults(vertices: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return whether each cell has coincident vertices, is clockwise, or is flat or dented seen from either side."""
    # Arithmetic on contiguous rows, one for each corner, is several times faster than on arrays of points.
    y, z = vertices.T[:, np.ascontiguousarray(cells.T)]
    across, up = np.roll(y, -1, axis=0) - y, np.roll(z, -1, axis=0) - z
    length = np.hypot(across, up)
    turn = across * np.roll(up, -1, axis=0) - up * np.roll(across, -1, axis=0)
    least = 1e-9 * length * np.roll(length, -1, axis=0)
    clockwise = (y[2] - y[0]) * (z[3] - z[1]) < (y[3] - y[1]) * (z[2] - z[0])
    return (length == 0.0).any(axis=0), clockwise, (turn <= least).any(axis=0), (-turn <= least).any(axis=0)


def oriented(vertices: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Return cells in counter-clockwise order; reject coincident vertices, cells of no area, corners not convex."""
    parts = [_faults(vertices, cells[first : first + PART]) for first in range(0, len(cells), PART)]
    duplicate, clockwise, *flat = (np.concatenate(flags) for flags in zip(*parts, strict=True))
    if duplicate.any():
        worst = int(np.argmax(duplicate))
        raise ValueError(
            f"{int(duplicate.sum())} cells have coincident vertices, the first is cell {worst} "
            f"with vertices {cells[worst].tolist()}: merge duplicate nodes and drop collapsed cells"
        )
    if clockwise.any() and not clockwise.all():
        raise ValueError(
            f"{int(clockwise.sum())} of {len(cells)} cells are inverted against the others, the first is cell "
            f"{int(np.argmax(clockwise))}: order the vertices of every cell the same way round"
        )
    if clockwise.all():
        cells = cells[:, ::-1].copy()
    is_degenerate = flat[int(clockwise.all())]
    if is_degenerate.any():
        worst = int(np.argmax(is_degenerate))
        raise ValueError(
            f"{int(is_degenerate.sum())} cells are degenerate or not convex, the first is cell {worst} with corners "
            f"{vertices[cells[worst]].tolist()}: repair the mesh"
        )
    return cells


def bilinear_point(corners: np.ndarray, xi, eta) -> tuple[np.ndarray, np.ndarray]:
    """Return the point at (xi, eta) of each cell, shape (n, 2), and the Jacobian determinant, shape (n,)."""
    xi, eta = np.asarray(xi)[..., None], np.asarray(eta)[..., None]
    a, b, c, d = (corners[:, k] for k in range(4))
    point = (1 - xi) * (1 - eta) * a + xi * (1 - eta) * b + xi * eta * c + (1 - xi) * eta * d
    along = (1 - eta) * (b - a) + eta * (c - d)
    across = (1 - xi) * (d - a) + xi * (c - b)
    return point, along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0]


def invert_bilinear(corners: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return bilinear coordinates (xi, eta), shape (n,) each, of points in their cells, by Newton's method."""
    xi = np.full(len(points), 0.5)
    eta = np.full(len(points), 0.5)
    # Each component has its own array, because arithmetic on columns of (n, 2) arrays is several times slower.
    a, b, c, d = (corners[:, k].T for k in range(4))
    e0, e1 = b - a
    f0, f1 = d - a
    g0, g1 = (a - b) + (c - d)
    p0, p1 = points.T - a
    for _ in range(12):
        along0, along1 = e0 + eta * g0, e1 + eta * g1
        miss0, miss1 = xi * along0 + eta * f0 - p0, xi * along1 + eta * f1 - p1
        across0, across1 = f0 + xi * g0, f1 + xi * g1
        rate = 1.0 / (along0 * across1 - along1 * across0)
        step_xi = (miss0 * across1 - miss1 * across0) * rate
        step_eta = (along0 * miss1 - along1 * miss0) * rate
        xi, eta = np.clip(xi - step_xi, -0.5, 1.5), np.clip(eta - step_eta, -0.5, 1.5)
        # Newton's method converges quadratically: after a step of this size (in xi, eta) only rounding errors remain.
        if max(np.abs(step_xi).max(initial=0.0), np.abs(step_eta).max(initial=0.0)) < 1e-9:
            break
    return xi, eta


def contains(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return whether each counter-clockwise convex cell (n, 4, 2) contains its point (n, 2), edges included."""
    x, y = np.ascontiguousarray(np.moveaxis(corners, -1, 0).swapaxes(1, 2))  # (4, n) each
    across, up = np.roll(x, -1, axis=0) - x, np.roll(y, -1, axis=0) - y
    side = across * (points[:, 1] - y) - up * (points[:, 0] - x)
    return (side >= -EDGE_TOLERANCE * (across**2 + up**2)).all(axis=0)


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
