"""Tables for leapfrog samples in two dimensions: all that a lookup takes side by side (kernels/include/cell.h)."""

import numpy as np

from ....medium import IndexField

# Numbers in such a table.
MOST_PACKED = 1 << 27
# Coefficients of the powers of a cell's fraction in the weights of its four spline coefficients, by power and weight.
SPLINE_POWERS = (
    np.array([[1.0, 4.0, 1.0, 0.0], [-3.0, 0.0, 3.0, 0.0], [3.0, -6.0, 3.0, 0.0], [-1.0, 3.0, -3.0, 1.0]]) / 6.0
)


def may_be_packed(field: IndexField, kind: type, most_bytes: int) -> bool:
    """Whether a uniform cubic grid has a table, `cell_polynomials`; not a volume, whose would be too large."""
    size = int(np.prod(field.samples.coefficient_shape)) * 16
    return field.geometry != "volume" and size <= MOST_PACKED and size * np.dtype(kind).itemsize <= most_bytes


def cell_polynomials(coefficients: np.ndarray, kind: type) -> np.ndarray:
    """The polynomial in each cell of a spline in two dimensions, flat, shape (16 n,) for n spline coefficients.

    Entry 16 e + 4 i + j belongs to the i-th power of the fraction along the first axis and the j-th along the second,
    in the cell whose 4 x 4 coefficients begin with coefficient e; zeros where no cell begins.
    """
    table = np.zeros((*coefficients.shape, 16), dtype=kind)
    rows, columns = (count - 3 for count in coefficients.shape)
    for second, weights in enumerate(SPLINE_POWERS):
        along = sum(weight * coefficients[:, j : j + columns] for j, weight in enumerate(weights) if weight)
        for first, weights_across in enumerate(SPLINE_POWERS):
            terms = (weight * along[i : i + rows] for i, weight in enumerate(weights_across) if weight)
            table[:rows, :columns, 4 * first + second] = sum(terms)
    return table.ravel()
