"""Quadrilateral meshes in a plane: geometry, checks, and finding the cell that holds a point.

The lookup uses uniform bins: each bin lists the cells whose bounding box touches it, and only those are tested for
containment, with the cell's four edges.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .grid import check_finite

GEOMETRIES = ("volume", "planar", "axisymmetric")
# Relative slack of the containment test: a point on an edge belongs to a cell on either side, never to none.
EDGE_SLACK = 1e-9


@dataclass(frozen=True, eq=False)
class CellBins:
    """Uniform bins over a mesh: cells of bin (i, j) are `cell[start[k]:start[k + 1]]` with k = i * count[1] + j."""

    origin: np.ndarray
    size: np.ndarray
    count: tuple[int, int]
    start: np.ndarray
    cell: np.ndarray


@dataclass(frozen=True, eq=False)
class QuadMesh:
    """A mesh of convex quadrilaterals.

    Attributes:
        vertices: Vertex coordinates [m], shape (vertex_count, 2): (y, z) if planar, (r, z) if axisymmetric.
        cells: Vertex indices of each cell in order around it, shape (cell_count, 4).
        geometry: "planar" or "axisymmetric".
        shape: Vertices along both directions of a structured mesh, or None.

    Raises:
        ValueError: Vertices that are not finite or coincide (only in a cell if the mesh is structured: it may close on
            itself in a seam), cells that are inverted, not convex or of no area, negative radii, indices out of range.
    """

    vertices: np.ndarray
    cells: np.ndarray
    geometry: str = "planar"
    shape: tuple[int, int] | None = None

    def __post_init__(self):
        """Check the mesh and orient every cell counter-clockwise."""
        vertices = np.array(self.vertices, dtype=np.float64)
        cells = np.array(self.cells)
        if self.geometry not in GEOMETRIES[1:]:
            raise ValueError(f"a quadrilateral mesh is 'planar' or 'axisymmetric', got {self.geometry!r}")
        if vertices.ndim != 2 or vertices.shape[1] != 2:
            raise ValueError(f"vertices must have shape (vertex_count, 2), got {vertices.shape}")
        if cells.ndim != 2 or cells.shape[1] != 4 or len(cells) == 0 or not np.issubdtype(cells.dtype, np.integer):
            raise ValueError(f"cells must be whole numbers of shape (cell_count, 4), got {cells.dtype} {cells.shape}")
        check_finite(vertices, "the mesh vertices")
        if cells.min() < 0 or cells.max() >= len(vertices):
            raise ValueError(f"cells refer to vertices {cells.min()} to {cells.max()}, there are {len(vertices)}")
        if self.geometry == "axisymmetric" and vertices[:, 0].min() < 0.0:
            raise ValueError(f"{int((vertices[:, 0] < 0).sum())} vertices have a negative radius")
        cells = _orient(vertices, cells.astype(np.int32))
        if self.shape is None:
            _refuse_duplicates(vertices)
        for name, value in (("vertices", vertices), ("cells", cells)):
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    @classmethod
    def structured(cls, first, second, geometry: str = "planar") -> "QuadMesh":
        """A mesh from two vertex coordinate arrays of shape (ni, nj): y and z, or r and z [m]."""
        first, second = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
        if first.ndim != 2 or first.shape != second.shape or min(first.shape) < 2:
            raise ValueError(
                "a structured mesh needs two coordinate arrays of one shape (ni, nj), at least (2, 2); "
                f"got {first.shape} and {second.shape}"
            )
        index = np.arange(first.size, dtype=np.int32).reshape(first.shape)
        cells = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
        return cls(np.stack([first.ravel(), second.ravel()], axis=1), cells, geometry, first.shape)

    @cached_property
    def corners(self) -> np.ndarray:
        """Vertex coordinates of each cell [m], shape (cell_count, 4, 2)."""
        return self.vertices[self.cells]

    @cached_property
    def cell_area(self) -> np.ndarray:
        """Area of each cell [m2], shape (cell_count,)."""
        return _area(self.corners)

    @cached_property
    def cell_centroid(self) -> np.ndarray:
        """Centroid of each cell [m], shape (cell_count, 2); of its volume of revolution if axisymmetric.

        Exact by 3 x 3 Gauss points in the bilinear map.
        """
        node, weight = np.polynomial.legendre.leggauss(3)
        total = np.zeros(len(self.cells))
        moment = np.zeros((len(self.cells), 2))
        for a, wa in zip(node, weight, strict=True):
            for b, wb in zip(node, weight, strict=True):
                xi, eta = 0.5 * (a + 1), 0.5 * (b + 1)
                point, jacobian = bilinear_point(self.corners, xi, eta)
                share = 0.25 * wa * wb * np.abs(jacobian)
                if self.geometry == "axisymmetric":
                    share = share * point[:, 0]
                total += share
                moment += share[:, None] * point
        return moment / total[:, None]

    @cached_property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest coordinates [m]."""
        return self.vertices.min(axis=0), self.vertices.max(axis=0)

    @cached_property
    def cell_size(self) -> np.ndarray:
        """The paper's l = sqrt(a b) of each cell [m]: a, b are the mean lengths of its opposite sides."""
        side = np.linalg.norm(np.roll(self.corners, -1, axis=1) - self.corners, axis=2)
        return np.sqrt(0.5 * (side[:, 0] + side[:, 2]) * 0.5 * (side[:, 1] + side[:, 3]))

    @cached_property
    def neighbors(self) -> np.ndarray:
        """Cell behind each edge of each cell, -1 at the mesh's boundary, shape (cell_count, 4); edge k ends at k + 1.

        Edges are told by their vertices: across a seam with vertices of its own on either side there is no neighbour.
        """
        edge = np.sort(np.stack([self.cells, np.roll(self.cells, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
        key = edge[:, 0].astype(np.int64) * len(self.vertices) + edge[:, 1]
        order = np.argsort(key, kind="stable")
        pair = np.flatnonzero(key[order][1:] == key[order][:-1])
        result = np.full(len(key), -1, dtype=np.int32)
        result[order[pair]] = order[pair + 1] // 4
        result[order[pair + 1]] = order[pair] // 4
        return result.reshape(-1, 4)

    @cached_property
    def bins(self) -> CellBins:
        """Uniform bins, about one per cell."""
        low, high = self.box
        extent = np.maximum(high - low, 1e-300)
        count = np.maximum(1, np.sqrt(len(self.cells) * extent / extent[::-1]).astype(int))
        count = np.minimum(count, 4096)
        size = extent / count
        slack = EDGE_SLACK * extent
        first = np.clip(((self.corners.min(axis=1) - slack - low) / size).astype(int), 0, count - 1)
        last = np.clip(((self.corners.max(axis=1) + slack - low) / size).astype(int), 0, count - 1)
        span = last - first + 1
        entries = span.prod(axis=1)
        cell = np.repeat(np.arange(len(self.cells)), entries)
        within = np.arange(entries.sum()) - np.repeat(np.cumsum(entries) - entries, entries)
        row = first[cell, 0] + within // span[cell, 1]
        column = first[cell, 1] + within % span[cell, 1]
        key = row * count[1] + column
        order = np.argsort(key, kind="stable")
        start = np.searchsorted(key[order], np.arange(count.prod() + 1)).astype(np.int32)
        return CellBins(low, size, (int(count[0]), int(count[1])), start, cell[order].astype(np.int32))

    def locate(self, points: np.ndarray) -> np.ndarray:
        """Index of the cell that holds each point, -1 where none does; points (n, 2) [m], result (n,)."""
        points = np.asarray(points, dtype=np.float64)
        bins = self.bins
        low, high = self.box
        slack = EDGE_SLACK * (high - low)
        inside = np.all((points >= low - slack) & (points <= high + slack), axis=1)
        place = np.floor((np.where(inside[:, None], points, low) - bins.origin) / bins.size).astype(np.int64)
        place = np.clip(place, 0, np.array(bins.count) - 1)
        found = np.full(len(points), -1, dtype=np.int64)
        key = np.where(inside, place[:, 0] * bins.count[1] + place[:, 1], 0)
        start, stop = bins.start[key], np.where(inside, bins.start[key + 1], bins.start[key])
        open_rows = np.flatnonzero(stop > start)
        for trial in range(int((stop - start).max(initial=0))):
            open_rows = open_rows[(found[open_rows] < 0) & (start[open_rows] + trial < stop[open_rows])]
            if len(open_rows) == 0:
                break
            candidate = bins.cell[start[open_rows] + trial]
            holds = contains(self.corners[candidate], points[open_rows])
            found[open_rows[holds]] = candidate[holds]
        return found

    def local_coordinates(self, cell: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Bilinear coordinates (xi, eta) in [0, 1] of points within their cells."""
        return invert_bilinear(self.corners[cell], points)


def bilinear_point(corners: np.ndarray, xi, eta) -> tuple[np.ndarray, np.ndarray]:
    """Point at (xi, eta) of each cell, shape (n, 2), and the Jacobian determinant, shape (n,)."""
    xi, eta = np.asarray(xi)[..., None], np.asarray(eta)[..., None]
    a, b, c, d = (corners[:, k] for k in range(4))
    point = (1 - xi) * (1 - eta) * a + xi * (1 - eta) * b + xi * eta * c + (1 - xi) * eta * d
    along = (1 - eta) * (b - a) + eta * (c - d)
    across = (1 - xi) * (d - a) + xi * (c - b)
    return point, along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0]


def invert_bilinear(corners: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Newton's method for the bilinear coordinates; quadratic, starts at the cell's middle."""
    xi = np.full(len(points), 0.5)
    eta = np.full(len(points), 0.5)
    a, b, c, d = (corners[:, k] for k in range(4))
    for _ in range(12):
        miss = bilinear_point(corners, xi, eta)[0] - points
        along = (1 - eta)[:, None] * (b - a) + eta[:, None] * (c - d)
        across = (1 - xi)[:, None] * (d - a) + xi[:, None] * (c - b)
        determinant = along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0]
        step_xi = (miss[:, 0] * across[:, 1] - miss[:, 1] * across[:, 0]) / determinant
        step_eta = (along[:, 0] * miss[:, 1] - along[:, 1] * miss[:, 0]) / determinant
        xi, eta = np.clip(xi - step_xi, -0.5, 1.5), np.clip(eta - step_eta, -0.5, 1.5)
        if max(np.abs(step_xi).max(initial=0.0), np.abs(step_eta).max(initial=0.0)) < 1e-14:
            break
    return xi, eta


def contains(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Whether each counter-clockwise convex cell holds its point, edges included."""
    edge = np.roll(corners, -1, axis=1) - corners
    toward = points[:, None, :] - corners
    side = edge[..., 0] * toward[..., 1] - edge[..., 1] * toward[..., 0]
    slack = EDGE_SLACK * np.sum(edge**2, axis=2)
    return (side >= -slack).all(axis=1)


def _area(corners: np.ndarray) -> np.ndarray:
    first, second = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    return 0.5 * (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])


def _refuse_duplicates(vertices: np.ndarray) -> None:
    """Refuse a place that has two vertices: the cells on either side would look like neighbours and not be."""
    _, first, inverse = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    if len(first) == len(vertices):
        return
    original = first[inverse.ravel()]
    double = np.flatnonzero(original != np.arange(len(vertices)))
    raise ValueError(
        f"{len(double)} vertices lie in the same place as another, the first are vertices {original[double[0]]} and "
        f"{double[0]} at {vertices[double[0]].tolist()}: merge duplicate nodes"
    )


def _orient(vertices: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Turn clockwise cells round; refuse cells with coincident vertices, no area, or a corner that is not convex."""
    corners = vertices[cells]
    edge = np.roll(corners, -1, axis=1) - corners
    length = np.linalg.norm(edge, axis=2)
    double = (length == 0.0).any(axis=1)
    if double.any():
        worst = int(np.argmax(double))
        raise ValueError(
            f"{int(double.sum())} cells have coincident vertices, the first is cell {worst} "
            f"with vertices {cells[worst].tolist()}: merge duplicate nodes and drop collapsed cells"
        )
    clockwise = _area(corners) < 0.0
    if clockwise.any() and not clockwise.all():
        raise ValueError(
            f"{int(clockwise.sum())} of {len(cells)} cells are inverted against the others, the first is cell "
            f"{int(np.argmax(clockwise))}: order the vertices of every cell the same way round"
        )
    if clockwise.all():
        cells = cells[:, ::-1].copy()
        corners = vertices[cells]
        edge = np.roll(corners, -1, axis=1) - corners
        length = np.linalg.norm(edge, axis=2)
    onward = np.roll(edge, -1, axis=1)
    turn = edge[..., 0] * onward[..., 1] - edge[..., 1] * onward[..., 0]
    bent = (turn <= 1e-9 * length * np.roll(length, -1, axis=1)).any(axis=1)
    if bent.any():
        worst = int(np.argmax(bent))
        raise ValueError(
            f"{int(bent.sum())} cells are degenerate or not convex, the first is cell {worst} with corners "
            f"{corners[worst].tolist()}: repair the mesh"
        )
    return cells
