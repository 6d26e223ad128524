"""Quadrilateral meshes in a plane: geometry, checks, and finding the cell that contains a point."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from aerokernels.derived import Derived
from aerokernels.display.shown import shown
from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.medium.grid import as_points, check_finite
from aerokernels.medium.mesh_cells import (
    EDGE_TOLERANCE,
    Bins,
    bilinear_point,
    bins_of,
    cells_across,
    check_duplicates,
    contains,
    invert_bilinear,
    oriented,
)

GEOMETRIES = ("volume", "planar", "axisymmetric")
# Gauss points of the unit interval, exact for cubic polynomials.
GAUSS_2 = (0.5 - 0.5 / 3.0**0.5, 0.5 + 0.5 / 3.0**0.5)


@dataclass(frozen=True, eq=False)
class Places:
    """The cells of a mesh in which points [m], shape (n, 2), lie: the points `rows` that are in one, and its `cell`."""

    mesh: "QuadMesh"
    points: np.ndarray
    rows: np.ndarray
    cell: np.ndarray

    @cached_property
    def local(self) -> tuple[np.ndarray, np.ndarray]:
        """Bilinear coordinates (xi, eta) of the points `rows` in their cells."""
        return self.mesh.local_coordinates(self.cell, self.points[self.rows])


@checked
@shown
@dataclass(frozen=True, eq=False)
class QuadMesh(Derived):
    """A mesh of convex quadrilaterals.

    Attributes:
        vertices: Vertex coordinates [m], shape (vertex_count, 2): (y, z) if planar, (r, z) if axisymmetric.
        cells: Vertex indices of each cell in order around it, shape (cell_count, 4).
        geometry: "planar" or "axisymmetric".
        shape: Vertices along both directions of a structured mesh, or None.
        parents: For meshes whose cells were cut from the flow's triangles, polygons or quadrilaterals: number of the
            flow's cell of which each cell is a part, from 0, shape (cell_count,). None where the cells are the flow's.
        whole: The mesh from which this one was made by cutting cells in four, or None; its vertices are the first ones.

    Raises:
        ValueError: Vertices that are not finite, or coincide (in a structured mesh only vertices of one cell: it may
            close on itself in a seam); cells that are inverted, not convex or of no area, or that lie in other cells;
            negative radii; indices out of range.
    """

    vertices: np.ndarray
    cells: np.ndarray
    geometry: str = "planar"
    shape: tuple[int, int] | None = None
    parents: np.ndarray | None = None
    whole: "QuadMesh | None" = None

    def __post_init__(self):
        """Check the mesh and orient every cell counter-clockwise."""
        vertices = np.array(self.vertices, dtype=np.float64)
        cells = np.array(self.cells)
        if not isinstance(self.geometry, str) or self.geometry not in GEOMETRIES[1:]:
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
        cells = oriented(vertices, cells.astype(np.int32))
        if self.shape is None and self.whole is None:  # cutting distinct edges gives distinct vertices
            check_duplicates(vertices)
        if self.parents is not None:
            parents = np.array(self.parents)
            if parents.shape != (len(cells),) or not np.issubdtype(parents.dtype, np.integer) or parents.min() < 0:
                raise ValueError(f"parents must be a number from 0 on for each of {len(cells)} cells")
            self.set_fields(parents=parents)
        self.set_fields(vertices=vertices, cells=cells)
        if self.whole is None:
            self._refuse_overlaps()

    def _refuse_overlaps(self) -> None:
        """Reject cells in other cells. The boundary of one of two meshes that overlap is within the other."""
        rim = np.flatnonzero((self.neighbors < 0).any(axis=1))
        middle = self.corners[rim].mean(axis=1)
        count = np.zeros(len(rim), np.int64)
        for row, _ in self.holding(middle):
            count += np.bincount(row, minlength=len(rim))
        if (count > 1).any():
            first = middle[np.argmax(count > 1)].tolist()
            axes = "r, z" if self.geometry == "axisymmetric" else "y, z"
            raise ValueError(
                f"{int((count > 1).sum())} cells at the edge of the mesh or of its blocks lie in other cells, the "
                f"first at {axes} = {first} m; of overlapping (overset) blocks leave out the cells of one where "
                "two overlap (in a file: iblank, vtkGhostType)"
            )

    @classmethod
    @checked
    def structured(cls, first: Numbers, second: Numbers, geometry: str = "planar") -> "QuadMesh":
        """Return a mesh from two vertex coordinate arrays of shape (ni, nj): y and z, or r and z [m]."""
        first, second = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
        if first.ndim != 2 or first.shape != second.shape or min(first.shape) < 2:
            raise ValueError(
                "a structured mesh needs two coordinate arrays of one shape (ni, nj), at least (2, 2); "
                f"got {first.shape} and {second.shape}"
            )
        index = np.arange(first.size, dtype=np.int32).reshape(first.shape)
        cells = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
        return cls(np.stack([first.ravel(), second.ravel()], axis=1), cells, geometry, first.shape)

    @property
    def array_shapes(self) -> tuple[list[tuple[int, ...]], list[tuple[int, ...]]]:
        """Shapes that an array with one entry for each vertex may have, and those of arrays with one for each cell."""
        rows = [] if self.shape is None else [self.shape]
        at_vertices, in_cells = [(len(self.vertices),), *rows], [(len(self.cells),), *((m - 1, n - 1) for m, n in rows)]
        return at_vertices, in_cells

    @cached_property
    def corners(self) -> np.ndarray:
        """Vertex coordinates of each cell [m], shape (cell_count, 4, 2)."""
        return self.vertices[self.cells]

    @cached_property
    def cell_centroid(self) -> np.ndarray:
        """Centroid of each cell [m], shape (cell_count, 2); of its volume of revolution if axisymmetric.

        Exact by 3 x 3 Gauss points in the bilinear map.
        """
        node, weight = np.polynomial.legendre.leggauss(3)
        total = np.zeros(len(self.cells))
        moment = np.zeros((len(self.cells), 2))
        for _, _, point, measure in self._gauss_points(0.5 * (node + 1.0), 0.5 * weight):
            total += measure
            moment += measure[:, None] * point
        return moment / total[:, None]

    def _gauss_points(self, nodes, weights) -> Iterator[tuple[float, float, np.ndarray, np.ndarray]]:
        """Yield xi, eta, the point in each cell and its weight in an integral over the cell [m2, or m3 per radian]."""
        for (xi, first), (eta, second) in product(zip(nodes, weights, strict=True), repeat=2):
            point, jacobian = bilinear_point(self.corners, xi, eta)
            measure = first * second * np.abs(jacobian)
            if self.geometry == "axisymmetric":
                measure = measure * point[:, 0]
            yield xi, eta, point, measure

    @cached_property
    def corner_weights(self) -> np.ndarray:
        """Weights of the corners in integrals of bilinear functions over cells [m2, or m3 per radian], shape (n, 4)."""
        weights = np.zeros((len(self.cells), 4))
        for a, b, _, measure in self._gauss_points(GAUSS_2, (0.5, 0.5)):
            weights += measure[:, None] * np.array([(1 - a) * (1 - b), a * (1 - b), a * b, (1 - a) * b])
        return weights

    @cached_property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest coordinates [m]; an axisymmetric box begins at r = 0, wherever the cells do."""
        low = self.vertices.min(axis=0)
        if self.geometry == "axisymmetric":
            low[0] = 0.0
        return low, self.vertices.max(axis=0)

    @cached_property
    def cell_size(self) -> np.ndarray:
        """The paper's l = sqrt(a b) of each cell [m]: a, b are the mean lengths of its opposite sides."""
        side = np.linalg.norm(np.roll(self.corners, -1, axis=1) - self.corners, axis=2)
        return np.sqrt(0.5 * (side[:, 0] + side[:, 2]) * 0.5 * (side[:, 1] + side[:, 3]))

    @cached_property
    def neighbors(self) -> np.ndarray:
        """Cell across each edge of each cell, -1 at the boundary, shape (cell_count, 4); edge k joins corners k, k + 1.

        Edges are identified by their vertices: cells at a seam with separate vertices are not neighbours.
        """
        return cells_across(self.cells, len(self.vertices))

    @cached_property
    def bins(self) -> Bins:
        """Bins over the cells' bounding boxes, which have a tolerance."""
        low, high = self.box
        tolerance = (EDGE_TOLERANCE * (high - low))[:, None]
        x = self.corners.T  # (2, 4, cell_count)
        first, last = (np.ascontiguousarray(end) for end in (x.min(axis=1) - tolerance, x.max(axis=1) + tolerance))
        return bins_of(first, last, low, high - low)

    @checked
    def locate(self, points: Numbers) -> np.ndarray:
        """Return the index of the cell that contains each point (n, 2) [m], shape (n,); -1 where none does.

        For a point on an edge it is the cell with the lowest index.
        """
        points = as_points(points, 2)
        result = np.full(len(points), -1, dtype=np.int64)
        for row, cell in self.holding(points):
            result[row[::-1]] = cell[::-1]  # cells ascend: in reverse order the lowest is written last
        return result

    def holding(self, points: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield all pairs of a point's index and a cell that contains it, for some points at a time; cells ascend."""
        for row, cell in self.bins.pairs(points):
            holds = contains(self.corners[cell], points[row])
            yield row[holds], cell[holds]

    def places(self, points: np.ndarray) -> Places:
        """Return the cells in which points (n, 2) [m] lie, as found by `locate`."""
        cell = self.locate(points)
        rows = np.flatnonzero(cell >= 0)
        return Places(self, points, rows, cell[rows])

    def local_coordinates(self, cell: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return bilinear coordinates (xi, eta) in [0, 1] of points in their cells."""
        return invert_bilinear(self.corners[cell], points)
