"""The index contrast on a quadrilateral mesh: values at vertices, interpolated in the cell that contains the point.

Interpolations:

    "bilinear"          value and gradient of the bilinear map's interpolant (default)
    "bilinear-barron"   value bilinear, gradient bilinear between node gradients of eq 7
    "idw"               the paper's: eq 6 for the value and for node gradients of eq 7
    "cells"             no interpolant: the average of the cell everywhere in it. Rays are straight: the gradient within
                        a cell is zero, and the jumps between cells, which are no physical surfaces, do not refract

"idw" does not reproduce a linear field and jumps at cell edges; it is provided for comparison only. With "cells" line
integrals are exactly those of the flow's cell averages; it is traced by the reference backend.

`kinks` tells how much the gradient jumps at the edges between cells: error control steps over edges only where that
allows it (tracing/engines/warp/kernels/edges.py).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aerokernels.derived import Derived
from aerokernels.display.shown import shown
from aerokernels.medium.averages.kept_averages import cell_deficits
from aerokernels.medium.averages.vertex_values import of_parents, values_and_smooth, vertex_gradients
from aerokernels.medium.grid import eq5_step
from aerokernels.medium.mesh import Places, QuadMesh
from aerokernels.medium.mesh_cells import PART

MESH_INTERPOLATIONS = ("bilinear", "bilinear-barron", "idw", "cells")
# Places along an edge at which both sides are compared: along it the gradient of a bilinear interpolant changes slowly.
PLACES = (0.0, 0.5, 1.0)


@shown
@dataclass(frozen=True, eq=False)
class MeshSamples(Derived):
    """Vertex values on a mesh.

    Attributes:
        mesh: The mesh.
        values: Contrast at the vertices, float64, shape (vertex_count,).
        interpolation: One of MESH_INTERPOLATIONS.
        averages: Averages over the cells from which the values were computed, shape (cell_count,); None for values
            that were given at the vertices.
    """

    mesh: QuadMesh
    values: np.ndarray
    interpolation: str
    averages: np.ndarray | None = None

    def __post_init__(self):
        """Check the choice of interpolation."""
        if self.interpolation not in MESH_INTERPOLATIONS:
            raise ValueError(
                f"interpolation {self.interpolation!r} is not known on a mesh: "
                f"choose one of {', '.join(MESH_INTERPOLATIONS)}"
            )
        if self.interpolation == "cells" and self.averages is None:
            raise ValueError("interpolation 'cells' needs averages over cells, and there are values at vertices only")

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

        Args:
            points: Local coordinates [m], shape (n, 2).
            places: The cells in which the points lie, if known.
            with_gradient: False omits the gradients of "bilinear", which are then zero.
        """
        if places is None:
            places = self.mesh.places(points)
        result, gradient = np.zeros(len(points)), np.zeros((len(points), 2))
        rows, cell = places.rows, places.cell
        if len(rows) == 0:
            return result, gradient
        if self.interpolation == "cells":
            assert self.averages is not None
            result[rows] = self.averages[cell]
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
    """Return the greatest jump of the bilinear interpolant's gradient at each edge of each cell [1/m], as below.

    It jumps along the normal of the edge only, which is faster to compute; `values` are those at the vertices.
    """

    def changes(cell: np.ndarray, edge: np.ndarray, other: np.ndarray, back: np.ndarray) -> list[np.ndarray]:
        near, far = _rises(mesh, values, cell, edge), _rises(mesh, values, other, back)
        # The neighbour's edge runs the other way round, and its inside is on the other side.
        return [np.abs(one + two) for one, two in zip(near, reversed(far), strict=True)]

    return _greatest(mesh, changes)


def gradient_jumps(mesh: QuadMesh, gradient_in: Callable[..., np.ndarray]) -> np.ndarray:
    """Return the greatest jump of the gradient at each edge of each cell [1/m], shape (cell_count, 4).

    At the boundary, where there is no other side, it is 0.

    Args:
        mesh: The mesh.
        gradient_in: Returns the gradients [1/m] in cells (n,) at points (n, 2) [m] with bilinear coordinates.
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
    found = []
    for place in PLACES:
        # The other family of the bilinear map's lines, from the edge into the cell.
        y, z, v = (
            (1.0 - place) * a + place * b for a, b in ((y3 - y0, y2 - y1), (z3 - z0, z2 - z1), (v3 - v0, v2 - v1))
        )
        found.append((v - (y * ahead + z * aside) * rise) / (z * ahead - y * aside))
    return found


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
