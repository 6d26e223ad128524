r"""Node values from cell averages: what finite-volume data on a uniform grid say at the nodes.

A cell is centred on its node and one spacing wide; the first and the last reach half a spacing beyond the box. For the
cubic spline the node values are those of the one spline S whose averages are the data, along each axis

    (1 / h) int S over [x_i - h/2, x_i + h/2] = average_i,

so a shock inside a cell keeps its place to a small part of the cell, where samples at the nodes would know it to half a
cell only. The linear and the monotone interpolant take the averages as node values: their integral along a whole line
is that of the data, and the h^2 / 24 of the second derivative that this leaves out is no more than their own error.
In an axisymmetric field averages are over the (r, z) rectangle, without the weight r, and even in r.
"""

import numpy as np

from . import spline


def node_values(average: np.ndarray, interpolation: str, even_first_axis: bool) -> np.ndarray:
    """Values at the nodes, float64, shape of `average`.

    Args:
        average: Averages over the cells, one axis per coordinate.
        interpolation: One of spline.INTERPOLATIONS.
        even_first_axis: The field is mirrored at the first node of axis 0.
    """
    values = np.asarray(average, dtype=np.float64)
    if interpolation != "cubic":
        return values
    for axis in range(values.ndim):
        values = _along(values, axis, even_first_axis and axis == 0)
    return values


def _along(average: np.ndarray, axis: int, even_start: bool) -> np.ndarray:
    from scipy.sparse.linalg import splu

    count = average.shape[axis]
    matrix = spline.end_conditions(count, even_start)
    before, after = _piece(0.5, 1.0), _piece(0.0, 0.5)
    for node in range(count):
        first, last = node == 0, node == count - 1
        if first and even_start:
            matrix[1, :4] = 2.0 * after
        elif first:
            matrix[1, :4] = _piece(-0.5, 0.5)
        elif last:
            matrix[count, count - 2 : count + 2] = _piece(0.5, 1.5)
        else:
            row = np.zeros(5)
            row[:4] += before
            row[1:] += after
            matrix[node + 1, node - 1 : node + 4] = row
    moved = np.moveaxis(average, axis, 0)
    right = np.zeros((count + 2, moved[0].size))
    right[1:-1] = moved.reshape(count, -1)
    coefficient = splu(matrix.tocsc()).solve(right)
    nodes = (coefficient[:-2] + 4.0 * coefficient[1:-1] + coefficient[2:]) / 6.0
    return np.moveaxis(nodes.reshape(moved.shape), 0, axis)


def _piece(low: float, high: float) -> np.ndarray:
    """Integral of the four cubic B-spline weights over a stretch of one cell, by two-point Gauss (exact)."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    place = middle + half / np.sqrt(3.0) * np.array([-1.0, 1.0])
    value: np.ndarray = spline.weights("cubic", place)[0]
    return half * value.sum(axis=1)
