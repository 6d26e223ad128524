"""Weights of the vertices of a mesh in averages over the flow's cells, as sparse matrices.

The mesh's cells may be parts of the flow's cells (`QuadMesh.parents`).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..derived import Derived
from .mesh import QuadMesh


@dataclass(frozen=True, eq=False)
class CellShares(Derived):
    """Weights of vertices in integrals of a bilinear interpolant over the flow's cells.

    Attributes:
        share: Weights [m2, if axisymmetric m3 per radian], sparse by rows, shape (flow's cells, vertices).
        turned: The transpose of `share`, sparse by rows.
        area: Area of each of the flow's cells [m2], shape (flow's cells,).
        parts: The mesh whose cells are parts of the flow's cells.
    """

    share: Any
    turned: Any
    area: np.ndarray
    parts: QuadMesh

    @cached_property
    def center(self) -> np.ndarray:
        """Mean of the centroids of each cell's parts [m], shape (flow's cells, 2)."""
        moments = [np.bincount(_parents(self.parts), self.parts.cell_area * c) for c in self.parts.cell_centroid.T]
        return np.stack(moments, axis=1) / self.area[:, None]

    @cached_property
    def size(self) -> np.ndarray:
        """Sum of the weights of each of the flow's cells, shape (flow's cells,)."""
        return np.asarray(self.share.sum(axis=1))

    @cached_property
    def whole(self) -> np.ndarray:
        """Sum of the weights of each vertex, shape (vertices,)."""
        return np.asarray(self.share.sum(axis=0))

    @cached_property
    def alone(self) -> np.ndarray:
        """Which vertices belong to only one of the flow's cells, shape (vertices,)."""
        return np.diff(self.turned.indptr) == 1

    @cached_property
    def across(self) -> Any:
        """Which cells share an edge, each cell with itself included: sparse, shape (flow's cells, flow's cells)."""
        edge = self.turned[np.flatnonzero(np.diff(self.turned.indptr) == 2)].astype(bool).astype(np.int32)
        return (edge.T @ edge).tocsr()

    def lacks(self, average: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return the averages minus the means of the interpolant of `values`, shape (flow's cells,)."""
        return np.asarray(average - (self.share @ values) / self.size)


def cell_shares(mesh: QuadMesh) -> CellShares:
    """Return the weights of a mesh, which are cached on it."""
    return mesh.derive("cell shares", lambda: _made(mesh))


def _made(mesh: QuadMesh) -> CellShares:
    from scipy.sparse import csr_array

    parents = _parents(mesh)
    count = int(parents.max()) + 1
    rows, columns = np.repeat(parents, 4), mesh.cells.ravel()
    share = csr_array((mesh.corner_weights.ravel(), (rows, columns)), shape=(count, len(mesh.vertices)))
    share.sum_duplicates()
    area = np.bincount(parents, mesh.cell_area)
    return CellShares(share, share.T.tocsr(), area, mesh)


def _parents(mesh: QuadMesh) -> np.ndarray:
    return np.arange(len(mesh.cells)) if mesh.parents is None else mesh.parents
