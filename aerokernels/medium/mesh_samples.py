"""The index contrast on a quadrilateral mesh: values at vertices, interpolated in the cell that contains the point.

"bilinear" has value and gradient of the bilinear map's interpolant; "bilinear-barron" the gradients of eq 7 at nodes;
"idw" eq 6 of the paper for both, for comparison only: it jumps at cell edges.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aerokernels.derived import Derived, cached_on
from aerokernels.display.shown import shown
from aerokernels.medium.averages.kept_averages import cell_deficits
from aerokernels.medium.averages.vertex_values import of_parents, values_and_smooth, vertex_gradients
from aerokernels.medium.bodies.crossings import as_lines, crossings
from aerokernels.medium.grid import eq5_step, local_coordinates
from aerokernels.medium.mesh import Places, QuadMesh
from aerokernels.medium.mesh_cells import PART

MESH_INTERPOLATIONS = ("bilinear", "bilinear-barron", "idw")
# Places along an edge at which both sides are compared: along it the gradient of a bilinear interpolant changes slowly.
PLACES = (0.0, 0.5, 1.0)


@shown
@dataclass(frozen=True, eq=False)
class MeshSamples(Derived):
    """Vertex values on a mesh."""

    mesh: QuadMesh
    values: np.ndarray  # contrast at the vertices, float64, shape (vertex_count,)
    interpolation: str  # one of MESH_INTERPOLATIONS
    averages: np.ndarray | None = None  # over the cells, from which the values were computed, shape (cell_count,)

    def __post_init__(self):
        """Check the choice of interpolation."""
        if self.interpolation not in MESH_INTERPOLATIONS:
            raise ValueError(
                f"interpolation {self.interpolation!r} is not known on a mesh: "
                f"choose one of {', '.join(MESH_INTERPOLATIONS)}"
            )

    @property
    def places(self) -> QuadMesh:
        """The positions of the nodes, on which is cached what depends on nothing else."""
        return self.mesh

    @property
    def low(self) -> np.ndarray:
        """Lowest corner of the bounding box [m]."""
        return self.mesh.box[0]

    @property
    def high(self) -> np.ndarray:
        """Highest corner of the bounding box [m]."""
        return self.mesh.box[1]

    @cached_property
    def gradients(self) -> np.ndarray:
        """Node gradients of eq 7 [1/m], shape (vertex_count, 2)."""
        return vertex_gradients(self.mesh, self.values)

    @cached_property
    def lacking_by_cell(self) -> tuple[QuadMesh, np.ndarray] | None:
        """Deficit of the interpolant's mean from the average in each cell, shape (cell_count,), after its mesh.

        The mesh is that before cells were cut in four; None if the averages are not known. For parts of triangles and
        polygons beside a shock the deficit is doubled, and half the deficit of the initial values is added, because
        the average does not determine where within such a cell the gas changes.
        """
        if self.averages is None or self.interpolation != "bilinear":
            return None
        lacks = cell_deficits(self.mesh, self.averages, self.values)
        if self.mesh.parents is None:
            return self.mesh, lacks
        if self.mesh.whole is not None and self.mesh.whole.parents is None:
            return self.mesh.whole, of_parents(self.mesh, lacks)
        start, smooth = values_and_smooth(self.mesh, self.averages)
        unsure = lacks + 0.5 * cell_deficits(self.mesh, self.averages, start)
        return self.mesh, np.asarray(lacks + np.where(smooth[self.mesh.parents], 0.0, unsure))

    @cached_property
    def kinks(self) -> np.ndarray:
        """Greatest jump of the gradient at each edge of each cell [1/m], shape (cell_count, 4)."""
        if self.interpolation == "bilinear":
            return bilinear_jumps(self.mesh, self.values)
        return gradient_jumps(self.mesh, self.gradients_in)

    @cached_property
    def paper_step(self) -> np.ndarray:
        """Step length [m] of the paper's eq 5 for every cell, shape (cell_count,)."""
        corner = self.values[self.mesh.cells]
        return eq5_step(corner.max(axis=1) - corner.min(axis=1), self.mesh.cell_size)

    def evaluate(
        self, points: np.ndarray, places: Places | None = None, with_gradient: bool = True
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return values, shape (n,), and gradients [1/m], shape (n, 2), at local points (n, 2); zero outside the mesh.

        `places` are the cells of the points, if known; `with_gradient` False omits the gradients of "bilinear".
        """
        if places is None:
            places = self.mesh.places(points)
        result, gradient = np.zeros(len(points)), np.zeros((len(points), 2))
        rows, cell = places.rows, places.cell
        if len(rows) == 0:
            return result, gradient
        at = (0.0, 0.0) if self.interpolation == "idw" else places.local
        result[rows] = np.sum(self._weights(cell, points[rows], *at) * self.values[self.mesh.cells[cell]], axis=1)
        if with_gradient or self.interpolation != "bilinear":
            gradient[rows] = self.gradients_in(cell, points[rows], *at)
        return result, gradient

    def _weights(self, cell: np.ndarray, points: np.ndarray, xi, eta) -> np.ndarray:
        """Return the weights of the corners of cells at points in them, shape (n, 4)."""
        if self.interpolation == "idw":
            return inverse_distance_weights(self.mesh.corners[cell], points)
        return np.stack([(1 - xi) * (1 - eta), xi * (1 - eta), xi * eta, (1 - xi) * eta], axis=1)

    def gradients_in(self, cell: np.ndarray, points: np.ndarray, xi, eta) -> np.ndarray:
        """Return the gradients [1/m] in cells at points (n, 2) [m] with bilinear coordinates xi, eta, shape (n, 2)."""
        vertex = self.mesh.cells[cell]
        if self.interpolation == "bilinear":
            return _bilinear_gradient(self.mesh.corners[cell], self.values[vertex], xi, eta)
        return np.einsum("nk,nkd->nd", self._weights(cell, points, xi, eta), self.gradients[vertex])


def inverse_distance_weights(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the weights of eq 6, shape (n, 4), in its product form, which is finite at a vertex."""
    distance = np.linalg.norm(points[:, None, :] - corners, axis=2)
    distance /= distance.max(axis=1, keepdims=True)
    product = np.stack([np.prod(np.delete(distance, k, axis=1), axis=1) for k in range(4)], axis=1)
    return product / product.sum(axis=1, keepdims=True)


def _bilinear_gradient(corners, value, xi, eta) -> np.ndarray:
    """Return the gradient of the bilinear interpolant: the inverse Jacobian applied to derivatives in (xi, eta)."""
    xi, eta = xi[:, None], eta[:, None]

    def derivatives(q):
        return (1 - eta) * (q[1] - q[0]) + eta * (q[2] - q[3]), (1 - xi) * (q[3] - q[0]) + xi * (q[2] - q[1])

    along, across = derivatives([corners[:, k] for k in range(4)])
    rise, lift = derivatives([value[:, k : k + 1] for k in range(4)])
    determinant = along[:, :1] * across[:, 1:] - along[:, 1:] * across[:, :1]
    first = (rise * across[:, 1:] - lift * along[:, 1:]) / determinant
    second = (lift * along[:, :1] - rise * across[:, :1]) / determinant
    return np.concatenate([first, second], axis=1)


def bilinear_jumps(mesh: QuadMesh, values: np.ndarray) -> np.ndarray:
    """As `gradient_jumps`, of a bilinear interpolant, whose gradient jumps along the normal of an edge only."""

    def changes(cell: np.ndarray, edge: np.ndarray, other: np.ndarray, back: np.ndarray) -> list[np.ndarray]:
        near, far = _rises(mesh, values, cell, edge), _rises(mesh, values, other, back)
        # The neighbour's edge runs the other way round, and its inside is on the other side.
        return [np.abs(one + two) for one, two in zip(near, reversed(far), strict=True)]

    return _greatest(mesh, changes)


def gradient_jumps(mesh: QuadMesh, gradient_in: Callable[..., np.ndarray]) -> np.ndarray:
    """Return the greatest jump of the gradient at each edge of each cell [1/m], shape (n, 4); 0 at the boundary.

    `gradient_in` returns the gradients in cells (n,) at points (n, 2) [m] with bilinear coordinates.
    """

    def changes(cell: np.ndarray, edge: np.ndarray, other: np.ndarray, back: np.ndarray) -> list[np.ndarray]:
        return [_change(mesh, gradient_in, cell, edge, other, back, place) for place in PLACES]

    return _greatest(mesh, changes)


def _greatest(mesh: QuadMesh, changes: Callable[..., list[np.ndarray]]) -> np.ndarray:
    """Return the greatest of the `changes` (cell, edge, cell behind, its edge) at each edge, shape (cell_count, 4)."""
    jumps = np.zeros(mesh.cells.shape, dtype=np.float32)  # of millions of cells, and only sizes
    across = mesh.neighbors
    for first in range(0, len(across), PART):
        part = across[first : first + PART]
        # Each edge is compared once, for the cell of the lower number, and counts for both.
        row, edge = np.nonzero(part > np.arange(first, first + len(part))[:, None])
        cell, other = row + first, part[row, edge]
        back = (across[other] == cell[:, None]).argmax(axis=1)
        jumps[cell, edge] = jumps[other, back] = np.maximum.reduce(changes(cell, edge, other, back))
    return jumps


def _rises(mesh: QuadMesh, values: np.ndarray, cell: np.ndarray, edge: np.ndarray) -> list[np.ndarray]:
    """Return the slopes of the bilinear interpolant into cells, along the normals of their edges, at each place."""
    corner = [mesh.cells[cell, (edge + k) % 4] for k in (0, 1, 2, 3)]
    (y0, z0), (y1, z1), (y2, z2), (y3, z3) = (mesh.vertices[k].T for k in corner)
    v0, v1, v2, v3 = (values[k] for k in corner)
    length = np.hypot(y1 - y0, z1 - z0)
    ahead, aside, rise = (y1 - y0) / length, (z1 - z0) / length, (v1 - v0) / length
    result = []
    for place in PLACES:
        # The other family of the bilinear map's lines, from the edge into the cell.
        y, z, v = (
            (1.0 - place) * a + place * b for a, b in ((y3 - y0, y2 - y1), (z3 - z0, z2 - z1), (v3 - v0, v2 - v1))
        )
        result.append((v - (y * ahead + z * aside) * rise) / (z * ahead - y * aside))
    return result


def _change(mesh, gradient_in, cell, edge, other, back, place: float) -> np.ndarray:
    """Return how much the gradient changes across edges at one place."""
    point = (1.0 - place) * mesh.corners[cell, edge] + place * mesh.corners[cell, (edge + 1) % 4]
    near = gradient_in(cell, point, *_on_edge(edge, place))
    far = gradient_in(other, point, *_on_edge(back, 1.0 - place))
    return np.hypot(*(near - far).T)


def _on_edge(edge: np.ndarray, place: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the bilinear coordinates of a place along each of the edges, which are numbered from 0 to 3."""
    xi = np.array([place, 1.0, 1.0 - place, 0.0])[edge]
    return xi, np.roll([place, 1.0, 1.0 - place, 0.0], 1)[edge]


LINES = 64  # lines that are cut together; speed only


def mesh_columns(mesh: QuadMesh, values: np.ndarray, position, direction, ends=None) -> np.ndarray:
    """Return integrals along lines of a value for each cell, shape (line_count,); zero outside the mesh.

    Lines are given by a point [m] and unit vectors; `ends` has the distances from the points at which each begins and
    ends [m], shape (2, line_count); None takes whole lines.
    """
    position, direction = as_lines(position, direction)
    if not np.isfinite(position).all():
        raise ValueError("the points of lines must be finite")
    if mesh.geometry == "planar" and (np.hypot(direction[:, 1], direction[:, 2]) == 0.0).any():
        raise ValueError("lines along x never leave a planar mesh")
    ends = None if ends is None else np.asarray(ends, dtype=np.float64)
    if not len(position):
        return np.zeros(0)
    # The next call may have other values on the mesh along the same lines.
    # Of many lines nothing is cached.
    pieces = _pieces if len(position) <= 512 else _pieces.function
    line, cell, length = pieces(mesh, position, direction, ends)
    return np.bincount(line, np.where(cell >= 0, values[cell], 0.0) * length, len(position))


@cached_on("mesh")
def _pieces(mesh: QuadMesh, position: np.ndarray, direction: np.ndarray, ends) -> tuple[np.ndarray, ...]:
    """Return the pieces of lines between cuts: number of the line, cell (-1 for none), and length [m]."""
    edges = np.unique(np.sort(np.stack([mesh.cells, np.roll(mesh.cells, -1, axis=1)], axis=-1).reshape(-1, 2)), axis=0)
    start, end = mesh.vertices[edges[:, 0]], mesh.vertices[edges[:, 1]]
    if mesh.geometry == "axisymmetric":
        keep = (start[:, 0] > 0.0) | (end[:, 0] > 0.0)
        start, end = start[keep], end[keep]
    result = []
    for first in range(0, len(position), LINES):
        rows = slice(first, first + LINES)
        cuts = crossings(start, end, mesh.geometry, position[rows], direction[rows])
        if ends is not None:  # cuts before the beginning or after the end are moved there: their pieces have no length
            begins, stops = (np.asarray(own)[rows, None] for own in ends)
            outer = np.where(np.isfinite(stops), stops, np.inf)
            cuts = np.sort(np.concatenate([begins, np.clip(cuts, begins, stops), outer], axis=1), axis=1)
        ahead, behind = cuts[:, 1:], cuts[:, :-1]
        line, piece = np.nonzero(np.isfinite(ahead) & (ahead > behind))
        ahead, behind = ahead[line, piece], behind[line, piece]
        middle = 0.5 * (ahead + behind)
        at = position[rows][line] + middle[:, None] * direction[rows][line]
        cell = mesh.locate(local_coordinates(at, mesh.geometry))
        result.append((first + line, cell, ahead - behind))
    return tuple(np.concatenate(parts) for parts in zip(*result, strict=True))
