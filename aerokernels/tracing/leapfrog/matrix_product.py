"""Multiply a long matrix by a small one in pieces, so that the result does not depend on the number of cores."""

import numpy as np

# Multiplications from which on the linear algebra library distributes a product over other cores and waits for them.
ONE_CORE = 1 << 18  # speed only


def matrix_product(rows: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Return rows (n, k) times a matrix (k, m), in pieces small enough for one core."""
    size = max(1, ONE_CORE // max(1, matrix.size))
    found = np.empty((len(rows), matrix.shape[1]), rows.dtype)
    for first in range(0, len(rows), size):
        np.matmul(rows[first : first + size], matrix, out=found[first : first + size])
    return found
