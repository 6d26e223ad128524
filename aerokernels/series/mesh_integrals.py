r"""Integrals along parallel straight rays through values on a quadrilateral mesh, as a linear map of the vertex values.

    I = \int f ds = sum over the samples of a ray, by the midpoint rule, of  ds sum_k w_k f_k

f is bilinear in each cell, w_k are the weights of its corners at the sample. The samples lie closer than the cells;
the remaining error is of second order and is measured together with the bending where a series is computed.
Outside the mesh f is zero. Cells are looked up once; a set of values then costs a product with a sparse matrix.
"""

from typing import Any

import numpy as np
from scipy import sparse

from ..device_arrays import host_array
from ..medium import QuadMesh
from ..medium.conserving import conserving_values
from .line_integrals import NotLinearError

SAMPLES_A_CELL = 4.0
LEAST_SAMPLES, MOST_SAMPLES = 64, 20_000  # of a ray
MOST_LOOKED_UP = 4_000_000  # samples of all rays together
CHUNK = 1 << 18  # of them at once; speed only


class MeshIntegrals:
    """The map from values on a mesh to integrals.

    Attributes:
        inside: Whether a ray crosses the mesh, shape (n,).
        length: Length of each ray in the mesh [m], shape (n,).
    """

    def __init__(self, mesh: QuadMesh, start: np.ndarray, direction: np.ndarray):
        """Look up the cells.

        Args:
            mesh: The mesh.
            start: Where the rays start [m], shape (n, 3).
            direction: Their direction, a unit vector, shape (3,).

        Raises:
            NotLinearError: More samples than are worth a matrix.
        """
        self.mesh = mesh
        reach = self._reach(start, direction)
        longest = float(reach.max(initial=0.0))
        count = int(np.clip(np.ceil(longest * SAMPLES_A_CELL / np.median(mesh.cell_size)), LEAST_SAMPLES, MOST_SAMPLES))
        if count * len(start) > MOST_LOOKED_UP:
            raise NotLinearError(f"{count * len(start):.1e} samples of a mesh are more than are worth a matrix")
        rows = max(1, CHUNK // count)  # speed only
        parts = [
            self._rows(start[first : first + rows], direction, reach[first : first + rows], count)
            for first in range(0, len(start), rows)
        ]
        self._matrix = sparse.csr_matrix(sparse.vstack(parts))
        self.length = np.asarray(self._matrix.sum(axis=1)).ravel()
        self.inside = self.length > 0.0

    def __call__(self, samples: Any, ambient: float = 0.0, device: str | None = None) -> np.ndarray:
        """The integrals of averages over the cells, or of values at the vertices, less a constant: shape (n,).

        They are summed on the processor, whatever the device.
        """
        values = np.asarray(host_array(samples), dtype=np.float64).ravel()
        if values.size == len(self.mesh.cells):
            values = conserving_values(self.mesh, values)
        return np.asarray(self._matrix @ values - ambient * self.length)

    def _reach(self, start: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Length of each ray beyond which there is no mesh [m], shape (n,)."""
        low, high = self.mesh.box
        ends = []
        if abs(direction[2]) > 0.0:
            ends.append(((high[1] if direction[2] > 0.0 else low[1]) - start[:, 2]) / direction[2])
        if self.mesh.geometry == "axisymmetric":
            across = np.hypot(*direction[:2])
            off = np.hypot(start[:, 0], start[:, 1])
            if across > 0.0:
                ends.append((off + high[0]) / across)
        elif abs(direction[1]) > 0.0:
            ends.append(((high[0] if direction[1] > 0.0 else low[0]) - start[:, 1]) / direction[1])
        if not ends:
            raise NotLinearError("rays along a planar mesh never leave it")
        return np.maximum(np.min(ends, axis=0), 0.0)

    def _rows(self, start: np.ndarray, direction: np.ndarray, reach: np.ndarray, count: int) -> sparse.csr_matrix:
        """The rows of the matrix of some rays."""
        way = (np.arange(count) + 0.5) / count * reach[:, None]
        points = (start[:, None, :] + way[..., None] * direction).reshape(-1, 3)
        axisymmetric = self.mesh.geometry == "axisymmetric"
        first = np.hypot(points[:, 0], points[:, 1]) if axisymmetric else points[:, 1]
        local = np.stack([first, points[:, 2]], axis=1)
        cell = self.mesh.locate(local)
        held = np.flatnonzero(cell >= 0)
        xi, eta = self.mesh.local_coordinates(cell[held], local[held])
        weight = np.stack([(1 - xi) * (1 - eta), xi * (1 - eta), xi * eta, (1 - xi) * eta], axis=1)
        ray = held // count
        weight *= (reach / count)[ray][:, None]
        columns = self.mesh.cells[cell[held]]
        shape = (len(start), len(self.mesh.vertices))
        return sparse.csr_matrix((weight.ravel(), (np.repeat(ray, 4), columns.ravel())), shape=shape)
