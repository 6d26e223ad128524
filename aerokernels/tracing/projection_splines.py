"""Integrals along z of spline coefficients, and splines over x and y at nodes and midway: see projection_tables.py."""

from functools import reduce

import numpy as np

from ..medium import spline as splines

# Weights of the coefficients in values, first and second derivatives per cell: at nodes, and in the middles of cells.
AT_NODES = ((1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0), (-0.5, 0.0, 0.5), (1.0, -2.0, 1.0))
AT_MIDDLES = (
    (1.0 / 48.0, 23.0 / 48.0, 23.0 / 48.0, 1.0 / 48.0),
    (-0.125, -0.625, 0.625, 0.125),
    (0.5, -0.5, -0.5, 0.5),
)


def integrals(planes: np.ndarray, begin: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, ...]:
    """Coefficients over x and y of s at `end`, and of its integral and twofold integral from `begin` to `end`.

    Places are in cells; shape (n, nx + 2, ny + 2). A step may cross the boundary of two cells.
    """
    low = int(np.clip(np.floor(begin[0]), 0, len(planes) - 4))
    high = int(np.clip(np.floor(end[-1]), 0, len(planes) - 4)) + 4
    value, single, double = (np.zeros((len(begin), high - low)) for _ in range(3))
    for row, (u, v) in enumerate(zip(begin, end, strict=True)):
        cell = int(np.clip(np.floor(v), low, high - 4))
        value[row, cell - low : cell - low + 4] = splines.weights("cubic", np.array(v - cell))[0]
        cell = int(np.clip(np.floor(u), low, high - 4))
        while u < v:
            upto = min(v, cell + 1.0) if cell < high - 4 else v
            columns = slice(cell - low, cell - low + 4)
            double[row] += (upto - u) * single[row]
            double[row, columns] += _twice(upto - cell) - _twice(u - cell) - (upto - u) * _once(u - cell)
            single[row, columns] += _once(upto - cell) - _once(u - cell)
            u, cell = upto, cell + 1
    flat = planes[low:high].reshape(high - low, -1)
    return tuple((weight @ flat).reshape(-1, *planes.shape[1:]) for weight in (value, single, double))


def _once(u: float) -> np.ndarray:
    """Integrals of the four weights of spline.py from 0 to u."""
    v = 1.0 - u
    return np.array(
        [
            (1.0 - v**4) / 24.0,
            (0.75 * u**4 - 2.0 * u**3 + 4.0 * u) / 6.0,
            (2.75 - (0.75 * v**4 - 2.0 * v**3 + 4.0 * v)) / 6.0,
            u**4 / 24.0,
        ]
    )


def _twice(u: float) -> np.ndarray:
    """Integrals of those."""
    v = 1.0 - u
    return np.array(
        [
            (u - (1.0 - v**5) / 5.0) / 24.0,
            (0.15 * u**5 - 0.5 * u**4 + 2.0 * u**2) / 6.0,
            (2.75 * u - (1.65 - (0.15 * v**5 - 0.5 * v**4 + 2.0 * v**2))) / 6.0,
            u**5 / 120.0,
        ]
    )


def at_places(c: np.ndarray, x: int, y: int, spacing, half: tuple[bool, bool]) -> np.ndarray:
    """The derivative of order x, y of splines with coefficients c, over the last two axes.

    Along each axis at the nodes, or in the middles of cells where `half` says so.
    """
    for axis, order, h, middle in ((-2, x, spacing[0], half[0]), (-1, y, spacing[1], half[1])):
        weights = (AT_MIDDLES if middle else AT_NODES)[order]
        last = c.shape[axis] - len(weights) + 1
        parts = (
            (weight / h**order) * (c[..., k : k + last, :] if axis == -2 else c[..., k : k + last])
            for k, weight in enumerate(weights)
            if weight
        )
        c = reduce(np.add, parts)
    return c
