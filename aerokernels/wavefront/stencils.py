"""Derivatives of a map along its rows and columns, from the neighbours that a pixel has inside the pupil."""

import numpy as np

# Finite differences: offset in pixels -> coefficients of the first and the second derivative at offset 0. Central ones
# first, then one-sided ones over three pixels and over two.
STENCILS = (
    {-1: (-0.5, 1.0), 0: (0.0, -2.0), 1: (0.5, 1.0)},
    {0: (-1.5, 1.0), 1: (2.0, -2.0), 2: (-0.5, 1.0)},
    {0: (1.5, 1.0), -1: (-2.0, -2.0), -2: (0.5, 1.0)},
    {0: (-1.0, 0.0), 1: (1.0, 0.0)},
    {0: (1.0, 0.0), -1: (-1.0, 0.0)},
)
REACH = 2


def three_in_a_row(lit: np.ndarray) -> bool:
    """Return whether three pixels in a row or a column have a sample, shape (ny, nx).

    Without them nothing tells how much a wavefront varies within a pixel, and errors due to the pixels are not known.
    """
    return any(bool((one[:-2] & one[1:-1] & one[2:]).any()) for one in (lit, lit.T))


def derivatives(values: np.ndarray, lit: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Return first and second derivatives along an axis, per pixel and pixel squared; 0 without neighbours."""
    values, free = (np.pad(array, REACH) for array in (values, lit))
    there = free.copy()
    slope, bend = np.zeros(values.shape), np.zeros(values.shape)
    for stencil in STENCILS:
        taken = free.copy()
        for place in stencil:
            taken &= np.roll(there, -place, axis)
        free &= ~taken
        for place, (first, second) in stencil.items():
            at = np.where(taken, np.roll(values, -place, axis), 0.0)
            slope += first * at
            bend += second * at
    inner = slice(REACH, -REACH)
    return slope[inner, inner], bend[inner, inner]


def derivative_weights(lit: np.ndarray, first: np.ndarray, second: np.ndarray, axis: int) -> np.ndarray:
    """Return the weights of the pixels in a sum of their derivatives along an axis, each times its moment.

    Args:
        lit: Mask of the pixels that have a sample, shape (ny, nx).
        first: Factors of the first derivatives [pixels], of the same shape.
        second: Twice the factors of the second derivatives.
        axis: The axis.
    """
    lit, first, second = (np.pad(array, REACH) for array in (lit, first, second))
    free, found = lit.copy(), np.zeros(lit.shape)
    for stencil in STENCILS:
        taken = free.copy()
        for place in stencil:
            taken &= np.roll(lit, -place, axis)
        free &= ~taken
        for place, (slope, bend) in stencil.items():
            found += np.roll(np.where(taken, slope * first + 0.5 * bend * second, 0.0), place, axis)
    return found[REACH:-REACH, REACH:-REACH]
