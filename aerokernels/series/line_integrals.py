r"""Integrals along parallel straight rays through samples on a uniform grid, as a linear map of the samples.

    I = \int f ds = sum over the planes k of nodes across the main axis of  w_k f(crossing of the ray with plane k)

Within a plane f is the spline of medium/spline.py; w_k are the integrals of the spline through the values on the
planes, from the start of the ray to its exit from the box (for rays along an axis this is the exact integral of the
tensor-product spline). Fourth order in the spacing for "cubic", second for "linear". The part that depends on the rays
alone is computed once. A set of samples then costs one pass over them where rays run along an axis; otherwise a
product with sparse matrices or, where these would not fit in memory, a sum over sheared planes (sheared_lattice.py).

Outside the box f is zero. A ray that leaves through a side collects nothing beyond it.
"""

from collections.abc import Callable
from functools import cached_property

import numpy as np
from scipy import sparse

from aerokernels.flow import GridMesh
from aerokernels.medium import QuadMesh
from aerokernels.medium.averages.kept_averages import conserving_values, cut_and_kept
from aerokernels.medium.grid import local_coordinates
from aerokernels.medium.refined import cells_of_four, quarters
from aerokernels.series.sheared_lattice import (
    PlaneValues,
    ShearedLattice,
    nodes_along,
    tensor_rows,
    thinned,
    to_coefficients,
)

MOST_ENTRIES = 8_000_000  # of the sparse matrices: 100 MB


class NotLinearError(ValueError):
    """Integrals that are not a linear map of the samples, or that this method cannot compute."""


class LineIntegrals:
    """The map from samples to integrals.

    Attributes:
        inside: Whether a ray leaves the box through its end, and not through a side, shape (n,).
        length: Length of each ray in the box, if it leaves through the end [m], shape (n,).
        axis: The array axis closest to the direction of the rays.
    """

    def __init__(self, mesh: GridMesh, start: np.ndarray, direction: np.ndarray, interpolation: str = "cubic"):
        """Compute the geometry of rays from `start` [m], shape (n, 3), along a unit vector.

        Raises:
            NotLinearError: Another interpolant than "cubic" and "linear", or rays across the planes of a planar or
                axisymmetric grid.
        """
        if interpolation not in ("cubic", "linear"):
            raise NotLinearError(f"interpolation {interpolation!r} is not linear in the samples")
        self.mesh, self.interpolation = mesh, interpolation
        if mesh.geometry != "volume" and abs(direction[2]) < np.hypot(direction[0], direction[1]):
            raise NotLinearError(f"rays of a {mesh.geometry} grid that run mostly across z are traced")
        self.axis = int(np.argmax(np.abs(direction))) if mesh.geometry == "volume" else 1
        space = self.axis if mesh.geometry == "volume" else 2  # the corresponding axis in space
        along = direction[space]
        low, high = (corner[self.axis] for corner in mesh.box)
        first = np.clip(start[:, space], low, high)
        last = high if along > 0.0 else low
        self.length = np.abs(last - first) / abs(along)
        places, self._which = np.unique(np.round((first - low) / mesh.spacing[self.axis], 12), return_inverse=True)
        self._others = [k for k in range(len(mesh.shape)) if k != self.axis]
        node = low + mesh.spacing[self.axis] * np.arange(mesh.shape[self.axis])

        def crossing(plane: int) -> np.ndarray:
            points = start + ((node[plane] - start[:, space]) / along)[:, None] * direction
            return self._lateral(points)

        self._crossing: Callable[[int], np.ndarray] = crossing
        ends = crossing(0), crossing(len(node) - 1)
        drift = np.abs(ends[1] - ends[0]).max()
        extent = min(mesh.spacing[k] * (mesh.shape[k] - 1) for k in self._others)
        self.is_aligned = bool(len(places) == 1 and drift <= 1e-12 * extent)
        # Averages along the axis are averages along a ray only where it does not move across the planes.
        averages = mesh.cell_averages and self.is_aligned
        count = len(node)
        end = np.array([count - 1.0 if along > 0.0 else 0.0])
        part = basis_integrals(end, count, interpolation) - basis_integrals(places, count, interpolation)
        weights = part @ to_coefficients(count, interpolation, False, averages)
        self._weights = weights * (mesh.spacing[self.axis] / along)  # of the planes [m], for each place of a start
        exit_point = start + ((last - start[:, space]) / along)[:, None] * direction
        entry = start + ((first - start[:, space]) / along)[:, None] * direction
        self.inside = self._within(self._lateral(entry)) & self._within(self._lateral(exit_point))
        self.inside &= self.length > 0.0
        self.direction, self.start, self._space = direction, start, space

    def __call__(self, samples: np.ndarray, ambient: float = 0.0) -> np.ndarray:
        """Return the integrals of samples, of the mesh's shape, minus a constant: shape (n,), float64."""
        if self.is_aligned:
            return self._values(contracted(samples, self._weights[0], self.axis)) - ambient * self.length
        if self.mesh.cell_averages:
            samples = nodes_along(samples, [self.axis], self.interpolation, self._is_even)
        support = 4 if self.interpolation == "cubic" else 2
        is_small = len(self._which) * self.mesh.shape[self.axis] * support ** len(self._others) <= MOST_ENTRIES
        if not is_small and self.lattice is not None:
            return self.lattice(samples, ambient)
        rows = self._all_rows if is_small else map(self._rows, range(self.mesh.shape[self.axis]))
        total = -ambient * self.length
        for one, plane in zip(rows, np.moveaxis(samples, self.axis, 0), strict=True):
            values = np.asarray(plane, np.float64)
            for axis, inverse in enumerate(self._inverse):
                values = inverse @ values if axis == 0 else (inverse @ np.ascontiguousarray(values.T)).T
            total += one @ values.ravel()
        return np.asarray(total)

    @cached_property
    def _values(self) -> PlaneValues:
        """The values of aligned rays from the sum of all planes."""
        lateral, counts = self._crossing(0), [self.mesh.shape[k] for k in self._others]
        within, averages = self._within(lateral), self.mesh.cell_averages
        return PlaneValues(self._cells(lateral), counts, within, self.interpolation, self._is_even, averages)

    @cached_property
    def _inverse(self) -> list[sparse.csr_matrix]:
        """The matrices from a plane's samples to its coefficients, along each axis."""
        counts, averages = [self.mesh.shape[k] for k in self._others], self.mesh.cell_averages
        return [
            thinned(to_coefficients(count, self.interpolation, self._is_even and k == 0, averages))
            for k, count in enumerate(counts)
        ]

    def _rows(self, plane: int) -> sparse.csr_matrix:
        """Return the matrix from a plane's coefficients to its part of the integrals; zero outside the box."""
        lateral, counts = self._crossing(plane), [self.mesh.shape[k] for k in self._others]
        rows = tensor_rows(self._cells(lateral), counts, self.interpolation, self._within(lateral))
        return sparse.csr_matrix(sparse.diags(self._weights[:, plane][self._which]) @ rows)

    @cached_property
    def _all_rows(self) -> list[sparse.csr_matrix]:
        return [self._rows(plane) for plane in range(self.mesh.shape[self.axis])]

    @cached_property
    def lattice(self) -> ShearedLattice | None:
        """The same map by lines through the nodes; None where it does not apply."""
        is_volume = self.mesh.geometry == "volume" and min(self.mesh.shape) >= 4
        if not is_volume or self.interpolation != "cubic" or len(self._weights) != 1:
            return None
        slope = self.direction[self._others] / self.direction[self._space] * self.mesh.spacing[self.axis]
        middle = self.mesh.shape[self.axis] // 2
        return ShearedLattice(
            self.mesh.shape,
            self.axis,
            self._cells(self._crossing(middle)),
            slope / self.mesh.spacing[self._others],
            middle,
            self._weights[0],
            self.inside,
            self.mesh.cell_averages,
        )

    @property
    def _is_even(self) -> bool:
        return self.mesh.geometry == "axisymmetric"

    def _lateral(self, points: np.ndarray) -> np.ndarray:
        """Return coordinates across the main axis [m], shape (n, 1 or 2)."""
        if self.mesh.geometry == "volume":
            return points[:, self._others]
        if self.mesh.geometry == "planar":
            return points[:, 1:2]
        return np.hypot(points[:, :1], points[:, 1:2])

    def _within(self, lateral: np.ndarray) -> np.ndarray:
        low, high = (corner[self._others] for corner in self.mesh.box)
        slack = 1e-9 * self.mesh.spacing[self._others]  # up to which a point counts as on the face
        return np.asarray(((lateral >= low - slack) & (lateral <= high + slack)).all(axis=1))

    def _cells(self, lateral: np.ndarray) -> np.ndarray:
        """Return coordinates across the main axis in cells from the first node."""
        return np.asarray((lateral - self.mesh.origin[self._others]) / self.mesh.spacing[self._others])


def basis_integrals(places: np.ndarray, count: int, interpolation: str) -> np.ndarray:
    """Return integrals of an axis's basis functions from its first node to places [cells], shape (n, coefficients)."""
    from scipy.interpolate import BSpline

    degree = 3 if interpolation == "cubic" else 1
    knots = np.arange(-degree, count + degree)
    integral = BSpline(knots, np.eye(count + degree - 1), degree).antiderivative()
    return np.asarray(integral(places) - integral(0.0))


def contracted(samples: np.ndarray, weights: np.ndarray, axis: int) -> np.ndarray:
    """Return the weighted sum along an axis, in the samples' own precision: one pass over them."""
    weights = weights.astype(samples.dtype)
    if axis == samples.ndim - 1:
        return samples @ weights
    if axis == 0:
        return (weights @ samples.reshape(len(samples), -1)).reshape(samples.shape[1:])
    return np.einsum("ijk,j->ik", samples, weights)


SAMPLES_A_CELL = 4.0
LEAST_SAMPLES, MOST_SAMPLES = 64, 20_000  # of a ray
MOST_LOOKED_UP = 4_000_000  # samples of all rays together
CHUNK = 1 << 18  # samples located at once; speed only


class MeshIntegrals:
    """The map from values on a mesh to integrals; `inside` and `length` [m] as in LineIntegrals, shape (n,)."""

    def __init__(self, mesh: QuadMesh, start: np.ndarray, direction: np.ndarray, interpolation: str | None = None):
        """Locate the cells along rays; "conserving" cell averages are those of cells cut in four.

        Raises:
            NotLinearError: Too many samples for a matrix.
        """
        self.mesh, self._start, self._direction = mesh, start, direction
        self._reaches = self._reach(start, direction)
        self._cuts = interpolation == "conserving" and mesh.parents is None
        self._matrices: dict[bool, sparse.csr_matrix] = {}
        self.length = np.asarray(self._matrix(self._cuts).sum(axis=1)).ravel()
        self.inside = self.length > 0.0

    def __call__(self, samples: np.ndarray, ambient: float = 0.0) -> np.ndarray:
        """Return integrals of cell averages, or of values at the vertices, minus a constant: shape (n,)."""
        values = np.asarray(samples, dtype=np.float64).ravel()
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
