"""The index contrast on a quadrilateral mesh: values at vertices, interpolated in the cell that holds the point.

Interpolations:

    "bilinear"          one scalar, its gradient the derivative of the bilinear map's interpolant (default)
    "bilinear-barron"   value bilinear, gradient bilinear between node gradients of eq 7
    "idw"               the paper: eq 6 for value and for node gradients of eq 7
    "cells"             no interpolant: the cell's average everywhere in it. Rays run straight, since nothing bends them
                        within a cell and the jumps between cells, which mean no surface of the gas, do not refract

"idw" does not reproduce a linear field and jumps at cell edges: it is there for comparison only. "cells" holds line
integrals exactly as the flow's file does, cell by cell, and is traced by the reference backend.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..derived import Derived
from ..display.shown import shown
from .grid import eq5_step
from .kept_averages import what_is_lacking
from .mesh import Places, QuadMesh
from .rows_of_cells import AveragesLacking, averages_lacking
from .vertex_values import of_parents, values_and_smooth, vertex_gradients

MESH_INTERPOLATIONS = ("bilinear", "bilinear-barron", "idw", "cells")


@shown
@dataclass(frozen=True, eq=False)
class MeshSamples(Derived):
    """Vertex values on a mesh.

    Attributes:
        mesh: The mesh.
        values: Contrast at the vertices, float64, shape (vertex_count,).
        interpolation: One of MESH_INTERPOLATIONS.
        averages: Averages over the cells that the values were made from, shape (cell_count,); None for values at the
            vertices of their own.
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

    @property
    def lacking(self) -> np.ndarray | None:
        """What of its average the interpolant lacks in each cell, shape (cell_count,); None where that is not known.

        Where triangles and polygons are cut, which keeps averages beside a shock too, it counts twice there, and half
        of what values at corners would lack is added: where in such a cell the gas changes, its average does not say.
        Of cells cut in four the comparison with those they were cut from says that (levels.py).
        """
        if self.lacking_by_cell is None:
            return None
        mesh, lacks = self.lacking_by_cell
        return lacks if mesh is self.mesh else lacks[self.mesh.parents]

    @cached_property
    def lacking_by_cell(self) -> tuple[QuadMesh, np.ndarray] | None:
        """The same on the mesh that was cut in four, where this one was made so: it has a quarter of the cells."""
        if self.averages is None or self.interpolation != "bilinear":
            return None
        lacks = what_is_lacking(self.mesh, self.averages, self.values)
        if self.mesh.parents is None:
            return self.mesh, lacks
        if self.mesh.whole is not None and self.mesh.whole.parents is None:
            return self.mesh.whole, of_parents(self.mesh, lacks)
        start, smooth = values_and_smooth(self.mesh, self.averages)
        unsure = lacks + 0.5 * what_is_lacking(self.mesh, self.averages, start)
        return self.mesh, np.asarray(lacks + np.where(smooth[self.mesh.parents], 0.0, unsure))

    @cached_property
    def averages_lacking(self) -> AveragesLacking | None:
        """What rows of cells, and cells, lack of the averages; None without these, or of no bilinear interpolant."""
        if self.averages is None or self.interpolation != "bilinear":
            return None
        return averages_lacking(self.mesh, self.averages, self.values)

    @cached_property
    def paper_step(self) -> np.ndarray:
        """Step length [m] of the paper's eq 5 for every cell, shape (cell_count,)."""
        corner = self.values[self.mesh.cells]
        return eq5_step(corner.max(axis=1) - corner.min(axis=1), self.mesh.cell_size)

    def evaluate(
        self, points: np.ndarray, places: Places | None = None, with_gradient: bool = True
    ) -> tuple[np.ndarray, np.ndarray]:
        """Value, shape (n,), and gradient [1/m], shape (n, 2), at local points (n, 2); zero outside the mesh.

        `places` says where they lie in the mesh, if that is known. Gradients may be left out: they are zero then.
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
        vertex = self.mesh.cells[cell]
        value = self.values[vertex]
        if self.interpolation == "idw":
            corners = self.mesh.corners[cell]
            weight = inverse_distance_weights(corners, points[rows])
            result[rows] = np.sum(weight * value, axis=1)
            gradient[rows] = np.einsum("nk,nkd->nd", weight, self.gradients[vertex])
            return result, gradient
        xi, eta = places.local
        weight = np.stack([(1 - xi) * (1 - eta), xi * (1 - eta), xi * eta, (1 - xi) * eta], axis=1)
        result[rows] = np.sum(weight * value, axis=1)
        if self.interpolation == "bilinear-barron":
            gradient[rows] = np.einsum("nk,nkd->nd", weight, self.gradients[vertex])
        elif with_gradient:
            gradient[rows] = _bilinear_gradient(self.mesh.corners[cell], value, xi, eta)
        return result, gradient


def inverse_distance_weights(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Weights of eq 6 in its product form, which is safe at a vertex; shape (n, 4)."""
    distance = np.linalg.norm(points[:, None, :] - corners, axis=2)
    distance /= distance.max(axis=1, keepdims=True)
    product = np.stack([np.prod(np.delete(distance, k, axis=1), axis=1) for k in range(4)], axis=1)
    return product / product.sum(axis=1, keepdims=True)


def _bilinear_gradient(corners, value, xi, eta) -> np.ndarray:
    """Gradient of the bilinear interpolant: the inverse Jacobian applied to its derivatives in (xi, eta)."""
    xi, eta = xi[:, None], eta[:, None]

    def derivatives(q):
        return (1 - eta) * (q[1] - q[0]) + eta * (q[2] - q[3]), (1 - xi) * (q[3] - q[0]) + xi * (q[2] - q[1])

    along, across = derivatives([corners[:, k] for k in range(4)])
    rise, lift = derivatives([value[:, k : k + 1] for k in range(4)])
    determinant = along[:, :1] * across[:, 1:] - along[:, 1:] * across[:, :1]
    first = (rise * across[:, 1:] - lift * along[:, 1:]) / determinant
    second = (lift * along[:, :1] - rise * across[:, :1]) / determinant
    return np.concatenate([first, second], axis=1)
