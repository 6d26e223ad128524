r"""Integrals along parallel straight rays through a quadrilateral mesh, a linear map of values at its vertices.

    I = \int f ds = sum over the samples of a ray, by the midpoint rule, of  ds sum_k w_k f_k

f is bilinear in each cell, w_k are the weights of its corners at the sample. The samples are closer together than the
cells. The remaining error is of second order; for a series it is measured together with the bending. Outside the mesh
f is zero. Cells are located once; a set of values then costs a product with a sparse matrix.
"""

from typing import Any

import numpy as np
from scipy import sparse

from aerokernels.medium.averages.kept_averages import conserving_values, cut_and_kept

from ..device_arrays import host_array
from ..medium import QuadMesh
from ..medium.grid import local_coordinates
from ..medium.refined import cells_of_four, quarters
from .line_integrals import NotLinearError

SAMPLES_A_CELL = 4.0
LEAST_SAMPLES, MOST_SAMPLES = 64, 20_000  # of a ray
MOST_LOOKED_UP = 4_000_000  # samples of all rays together
CHUNK = 1 << 18  # samples located at once; speed only


class MeshIntegrals:
    """The map from values on a mesh to integrals.

    Attributes:
        inside: Whether a ray crosses the mesh, shape (n,).
        length: Length of each ray in the mesh [m], shape (n,).
    """

    def __init__(self, mesh: QuadMesh, start: np.ndarray, direction: np.ndarray, interpolation: str | None = None):
        """Locate the cells along the rays.

        Args:
            mesh: The mesh.
            start: Starting points of the rays [m], shape (n, 3).
            direction: Their direction, a unit vector, shape (3,).
            interpolation: For cell averages: "conserving" on cells cut in four; None or "bilinear" on the cells as they
                are.

        Raises:
            NotLinearError: Too many samples for a matrix.
        """
        self.mesh, self._start, self._direction = mesh, start, direction
        self._reaches = self._reach(start, direction)
        self._cuts = interpolation == "conserving" and mesh.parents is None
        self._matrices: dict[bool, sparse.csr_matrix] = {}
        self.length = np.asarray(self._matrix(self._cuts).sum(axis=1)).ravel()
        self.inside = self.length > 0.0

    def __call__(self, samples: Any, ambient: float = 0.0, device: str | None = None) -> np.ndarray:
        """Return integrals of cell averages, or of values at the vertices, minus a constant: shape (n,).

        They are summed on the processor, whatever the device.
        """
        values = np.asarray(host_array(samples), dtype=np.float64).ravel()
        cuts = self._cuts and values.size == len(self.mesh.cells)
        if cuts:
            values = cut_and_kept(self.mesh, values, 0.0 if values.min() > 0.0 else -np.inf)[1]
        elif values.size == len(self.mesh.cells):
            values = conserving_values(self.mesh, values)
        return np.asarray(self._matrix(cuts) @ values - ambient * self.length)

    def _matrix(self, cuts: bool) -> sparse.csr_matrix:
        """Return the map from values at the mesh's vertices, or at those of the cells cut in four; built on demand."""
        if cuts not in self._matrices:
            reach, start = self._reaches, self._start
            cells = float(reach.max(initial=0.0)) / np.median(self.mesh.cell_size)
            count = int(np.clip(np.ceil(cells * SAMPLES_A_CELL), LEAST_SAMPLES, MOST_SAMPLES))
            if count * len(start) > MOST_LOOKED_UP:
                raise NotLinearError(f"{count * len(start):.1e} samples of a mesh are more than are worth a matrix")
            rows = max(1, CHUNK // count)  # speed only
            parts = [
                self._rows(start[first : first + rows], reach[first : first + rows], count, cuts)
                for first in range(0, len(start), rows)
            ]
            self._matrices[cuts] = sparse.csr_matrix(sparse.vstack(parts))
        return self._matrices[cuts]

    def _reach(self, start: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Return the length of each ray beyond which there is not a mesh [m], shape (n,)."""
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

    def _rows(self, start: np.ndarray, reach: np.ndarray, count: int, cuts: bool) -> sparse.csr_matrix:
        """Return the rows of the matrix for some rays."""
        way = (np.arange(count) + 0.5) / count * reach[:, None]
        points = (start[:, None, :] + way[..., None] * self._direction).reshape(-1, 3)
        local = local_coordinates(points, self.mesh.geometry)
        cell = self.mesh.locate(local)
        held = np.flatnonzero(cell >= 0)
        xi, eta = self.mesh.local_coordinates(cell[held], local[held])
        mesh, part = self.mesh, cell[held]
        if cuts:
            mesh, quarter, xi, eta = cells_of_four(mesh), *quarters(xi, eta)
            part = 4 * part + quarter
        weight = np.stack([(1 - xi) * (1 - eta), xi * (1 - eta), xi * eta, (1 - xi) * eta], axis=1)
        ray = held // count
        weight *= (reach / count)[ray][:, None]
        columns = mesh.cells[part]
        shape = (len(start), len(mesh.vertices))
        return sparse.csr_matrix((weight.ravel(), (np.repeat(ray, 4), columns.ravel())), shape=shape)
