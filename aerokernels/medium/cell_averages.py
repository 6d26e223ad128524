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
    count = average.shape[axis]
    matrix = spline.end_conditions(count, even_start)
    before, after = _piece(0.5, 1.0), _piece(0.0, 0.5)
    inner = np.zeros(5)
    inner[:4] += before
    inner[1:] += after
    for node in range(1, count - 1):
        spline.fill_row(matrix, node + 1, node - 1, inner)
    spline.fill_row(matrix, 1, 0, 2.0 * after if even_start else _piece(-0.5, 0.5))
    spline.fill_row(matrix, count, count - 2, _piece(0.5, 1.5))
    coefficient = spline.solve_along(matrix, average, axis)
    return np.moveaxis((coefficient[:-2] + 4.0 * coefficient[1:-1] + coefficient[2:]) / 6.0, 0, axis)


def _piece(low: float, high: float) -> np.ndarray:
    """Integral of the four cubic B-spline weights over a stretch of one cell, by two-point Gauss (exact)."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    place = middle + half / np.sqrt(3.0) * np.array([-1.0, 1.0])
    value: np.ndarray = spline.weights("cubic", place)[0]
    return half * value.sum(axis=1)
