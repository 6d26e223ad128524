"""Tables of spline coefficients for leapfrog samples: all that a lookup takes side by side (kernels/include/cell.h)."""

import numpy as np

from ....medium import IndexField

# Numbers in such a table.
MOST_PACKED = 1 << 27
# Coefficients of the powers of a cell's fraction in the weights of its four spline coefficients, by power and weight.
SPLINE_POWERS = (
    np.array([[1.0, 4.0, 1.0, 0.0], [-3.0, 0.0, 3.0, 0.0], [3.0, -6.0, 3.0, 0.0], [-1.0, 3.0, -3.0, 1.0]]) / 6.0
)


def may_be_packed(field: IndexField, kind: type, lanes: int, most_bytes: int) -> bool:
    """Whether a uniform cubic grid has a table: not a volume on a CPU, whose lanes share what one of them loads."""
    is_volume = field.geometry == "volume"
    if is_volume and lanes > 1:
        return False
    size = field.samples.coefficients.size * (4 if is_volume else 16)
    return size <= MOST_PACKED and size * np.dtype(kind).itemsize <= most_bytes


def packed_table(field: IndexField, kind: type) -> np.ndarray:
    """The table of a field: coefficients in fours, or the polynomials of cells; flat."""
    pack = in_fours if field.geometry == "volume" else cell_polynomials
    return pack(field.samples.coefficients, kind)


def in_fours(coefficients: np.ndarray, kind: type) -> np.ndarray:
    """Each number and the three after it, flat, shape (4 n,); zeros behind the end, where nothing is looked up."""
    padded: np.ndarray = np.concatenate([coefficients.ravel(), np.zeros(3)]).astype(kind)
    return np.lib.stride_tricks.sliding_window_view(padded, 4).ravel()


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
