r"""Values of splines between the nodes of a plane, as linear maps of the values at the nodes.

    value at a place = sum over the nodes of  (row of basis functions at the place) (inverse of the spline's matrix)

The inverse decays by a factor 0.27 a node, so entries below REST of the greatest one are dropped, and the map along one
axis is a sparse matrix of some forty entries a row. Places that form a grid themselves, such as the pixels of a pupil
along the axes, need one such matrix an axis; other places are interpolated from the plane's coefficients one by one.
"""

from typing import Any

import numpy as np
from scipy import sparse

from aerokernels.medium.spline import node_values

from ..medium import spline

REST = 1e-13
SPARSEST = 4.0  # grid points for each place on the grid; above it places are interpolated one by one; speed only
DECIMALS = 9  # of a place in cells, to which places count as equal


def to_coefficients(count: int, interpolation: str, even: bool, cell_averages: bool) -> np.ndarray:
    """Return the matrix from the samples of an axis to its coefficients, shape (coefficient_count, count)."""
    unit = np.eye(count)
    samples = to_nodes(count, interpolation, even) if cell_averages else unit
    return samples if interpolation == "linear" else spline.spline_along(samples, 0, even)


def to_nodes(count: int, interpolation: str, even: bool) -> np.ndarray:
    """Return the matrix from averages over the cells of an axis to values at its nodes, shape (count, count)."""
    unit = np.eye(count)
    return np.stack([node_values(unit[:, k], interpolation, even) for k in range(count)], axis=1)


def nodes_along(samples: np.ndarray, axes: Any, interpolation: str, even: bool) -> np.ndarray:
    """Convert cell averages to values at the nodes along some of the axes, in the samples' own precision."""
    for axis in axes:
        matrix = to_nodes(samples.shape[axis], interpolation, even and axis == 0).astype(samples.dtype)
        if axis == samples.ndim - 1:
            samples = samples @ matrix.T
        else:
            flat = samples.reshape(*samples.shape[: axis + 1], -1)
            samples = np.matmul(matrix, flat).reshape(samples.shape)
    return samples


def basis_rows(places: np.ndarray, count: int, interpolation: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the first coefficient and the weights of places [cells] along an axis, shapes (n,) and (n, support)."""
    held = np.clip(places, 0.0, count - 1.0)
    cell = np.minimum(held.astype(np.int64), count - 2)
    return cell, spline.weights(interpolation, held - cell)[0].T


def sparse_rows(places: np.ndarray, count: int, interpolation: str) -> sparse.csr_matrix:
    """Return the matrix from the coefficients of an axis to its values at places [cells]."""
    cell, weight = basis_rows(places, count, interpolation)
    support = weight.shape[1]
    columns = (cell[:, None] + np.arange(support)).ravel()
    starts = np.arange(len(places) + 1) * support
    shape = (len(places), count + support - 2)
    return sparse.csr_matrix((weight.ravel(), columns, starts), shape=shape)


def thinned(matrix: np.ndarray) -> sparse.csr_matrix:
    """Return a matrix without its entries below REST of the greatest one."""
    return sparse.csr_matrix(np.where(np.abs(matrix) > REST * np.abs(matrix).max(initial=0.0), matrix, 0.0))


class PlaneValues:
    """The map from the samples of a plane to the values at points of it."""

    def __init__(
        self,
        places: np.ndarray,
        counts: Any,
        within: np.ndarray,
        interpolation: str,
        even: bool = False,
        cell_averages: bool = False,
        inverted: tuple[bool, ...] = (False, False),
    ):
        """Compute the map.

        Args:
            places: Positions of the points [cells], shape (n, 1 or 2).
            counts: Nodes along each axis.
            within: Which of the points are in the plane; the others' values are zero, shape (n,).
            interpolation: "cubic" or "linear".
            even: The plane is mirrored at the first node of its first axis.
            cell_averages: The samples are cell averages.
            inverted: Axes along which the samples are sums of the spline's basis functions.
        """
        inverses = []
        for axis, count in enumerate(counts):
            once = to_coefficients(count, interpolation, even and axis == 0, False)
            twice = once @ once[1:-1] if inverted[axis] else once
            inverses.append(twice @ to_nodes(count, interpolation, even and axis == 0) if cell_averages else twice)
        self._within = within
        unique = [np.unique(np.round(places[:, k], DECIMALS), return_inverse=True) for k in range(len(counts))]
        cells = int(np.prod([len(values) for values, _ in unique]))
        self._index: np.ndarray | None = None
        if len(counts) == 1 or cells <= SPARSEST * len(places):
            self._maps = [
                thinned(sparse_rows(values, count, interpolation) @ inverse)
                for (values, _), count, inverse in zip(unique, counts, inverses, strict=True)
            ]
            self._index = np.ravel_multi_index([where for _, where in unique], [len(values) for values, _ in unique])
        else:
            self._maps = [thinned(inverse) for inverse in inverses]
            self._rows = tensor_rows(places, counts, interpolation)

    def __call__(self, plane: np.ndarray) -> np.ndarray:
        """Return values at the points, shape (n,), float64."""
        found = np.asarray(plane, np.float64)
        for axis, one in enumerate(self._maps):
            found = one @ found if axis == 0 else (one @ np.ascontiguousarray(found.T)).T
        values = self._rows @ found.ravel() if self._index is None else np.take(found, self._index)
        return np.where(self._within, values, 0.0)


def tensor_rows(places: np.ndarray, counts, interpolation: str, keep: np.ndarray | None = None) -> sparse.csr_matrix:
    """Return the matrix from a plane's coefficients to values at places [cells], shape (n, axes); 0 unless `keep`."""
    columns = np.zeros((len(places), 1), dtype=np.int64)
    values = np.ones((len(places), 1)) if keep is None else keep[:, None].astype(np.float64)
    size = 1
    for axis, count in enumerate(counts):
        cell, weight = basis_rows(places[:, axis], count, interpolation)
        support = weight.shape[1]
        total = count + support - 2
        column = cell[:, None] + np.arange(support)
        columns = (columns[:, :, None] * total + column[:, None, :]).reshape(len(places), -1)
        values = (values[:, :, None] * weight[:, None, :]).reshape(len(places), -1)
        size *= total
    starts = np.arange(len(places) + 1) * columns.shape[1]
    return sparse.csr_matrix((values.ravel(), columns.ravel(), starts), shape=(len(places), size))
