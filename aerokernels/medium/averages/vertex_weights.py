"""Weights of the vertices of a mesh in averages over the flow's cells, as sparse matrices.

The mesh's cells may be parts of the flow's cells (`QuadMesh.parents`).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...derived import Derived
from ..mesh import QuadMesh


@dataclass(frozen=True, eq=False)
class VertexWeights(Derived):
    """Weights of vertices in integrals of a bilinear interpolant over the flow's cells.

    Attributes:
        matrix: Weights [m2, if axisymmetric m3 per radian], sparse by rows, shape (flow's cells, vertices).
        transposed: The transpose of `matrix`, sparse by rows.
    """

    matrix: Any
    transposed: Any

    @cached_property
    def cell_total(self) -> np.ndarray:
        """Sum of the weights of each of the flow's cells, shape (flow's cells,)."""
        return np.asarray(self.matrix.sum(axis=1))

    @cached_property
    def vertex_total(self) -> np.ndarray:
        """Sum of the weights of each vertex, shape (vertices,)."""
        return np.asarray(self.matrix.sum(axis=0))

    @cached_property
    def single(self) -> np.ndarray:
        """Which vertices belong to only one of the flow's cells, shape (vertices,)."""
        return np.diff(self.transposed.indptr) == 1

    def deficit(self, average: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return the averages minus the means of the interpolant of `values`, shape (flow's cells,)."""
        return np.asarray(average - (self.matrix @ values) / self.cell_total)


def vertex_weights(mesh: QuadMesh) -> VertexWeights:
    """Return the weights of a mesh, which are cached on it."""
    return mesh.derive("vertex weights", lambda: _make(mesh))


def _make(mesh: QuadMesh) -> VertexWeights:
    from scipy.sparse import csr_array

    parents = _parents(mesh)
    count = int(parents.max()) + 1
    rows, columns = np.repeat(parents, 4), mesh.cells.ravel()
    matrix = csr_array((mesh.corner_weights.ravel(), (rows, columns)), shape=(count, len(mesh.vertices)))
    matrix.sum_duplicates()
    return VertexWeights(matrix, matrix.T.tocsr())


def _parents(mesh: QuadMesh) -> np.ndarray:
    return np.arange(len(mesh.cells)) if mesh.parents is None else mesh.parents
