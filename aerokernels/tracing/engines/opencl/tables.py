"""Tables for leapfrog samples in two dimensions, with contiguous data for each lookup (kernels/include/cell.h)."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ....medium import IndexField

# Greatest count of numbers in a table.
MOST_PACKED = 1 << 27
# The weights of a cell's four spline coefficients as polynomials of the fraction of the cell: six times their
# coefficients, by power and weight.
SPLINE_POWERS = ((1, 4, 1, 0), (-3, 0, 3, 0), (3, -6, 3, 0), (-1, 3, -3, 1))


def may_be_packed(field: IndexField, kind: type, most_bytes: int) -> bool:
    """Whether a uniform cubic grid gets a table of `cell_polynomials`; for a volume it would be too large."""
    size = int(np.prod(field.samples.coefficient_shape)) * 16
    return field.geometry != "volume" and size <= MOST_PACKED and size * np.dtype(kind).itemsize <= most_bytes


def cell_polynomials(coefficients: np.ndarray, kind: type) -> np.ndarray:
    """Return the polynomial in each cell of a spline in two dimensions, flat, shape (16 n,) for n spline coefficients.

    Entry 16 e + 4 i + j is the coefficient of the i-th power of the fraction along the first axis and the j-th along
    the second, in the cell whose 4 x 4 coefficients begin with coefficient e; zero if no cell begins there.
    """
    rows, columns = (count - 3 for count in coefficients.shape)
    # Fill plane by plane and interleave at the end, because scattered writes are slower.
    planes = np.empty((4, 4, rows, columns), dtype=kind)
    for second, along in enumerate(_by_powers(coefficients.T)):
        for first, values in enumerate(_by_powers(along.T)):
            planes[first, second] = values
    table = np.zeros((*coefficients.shape, 16), dtype=kind)
    table[:rows, :columns] = planes.reshape(16, rows, columns).transpose(1, 2, 0)
    return table.ravel()


def _by_powers(values: np.ndarray) -> Iterator[np.ndarray]:
    """Yield, for each power of the fraction along the first axis, the weighted sum of four consecutive values."""
    cells = len(values) - 3
    times = {size: values * (size / 6.0) for size in (1, 3, 4, 6)}
    for weights in SPLINE_POWERS:
        total: Any = 0.0
        for row, weight in enumerate(weights):
            if weight:
                add = np.add if weight > 0 else np.subtract
                term = times[abs(weight)][row : row + cells]
                total = add(total, term, out=total if row else None)
        yield total
