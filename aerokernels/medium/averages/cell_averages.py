r"""Node values on a uniform grid from finite-volume averages over cells centred on the nodes.

Each cell is one spacing wide; the first and the last extend half a spacing beyond the box. For the cubic interpolant
the node values are those of the spline S that has the given averages along each axis,

    (1 / h) int S over [x_i - h/2, x_i + h/2] = average_i,

so the position of a shock inside a cell is kept to a small fraction of the cell; samples at the nodes would determine
it only to half a cell. The linear and the monotone interpolant use the averages as node values: integrals along whole
lines equal those of the data, and the neglected h^2 / 24 times the second derivative is within these interpolants' own
error. In an axisymmetric field the averages are over the (r, z) rectangle, without the weight r, and even in r.
"""

import numpy as np

from .. import spline


def node_values(average: np.ndarray, interpolation: str, even_first_axis: bool) -> np.ndarray:
    """Return values at the nodes, float64, shape of `average`.

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
    """Return integrals of the four cubic B-spline weights over a part of one cell, by two-point Gauss (exact)."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    place = middle + half / np.sqrt(3.0) * np.array([-1.0, 1.0])
    value: np.ndarray = spline.weights("cubic", place)[0]
    return half * value.sum(axis=1)
