"""Multiply matrices on the calling thread's core alone.

BLAS divides a large product among its own threads, which wait for each other and for ours. A product that takes one
core 0.1 ms then takes ten times that processor time, and its rounding depends on the number of cores.
"""

import numpy as np

# Multiplications in a product of real matrices up to which OpenBLAS uses one thread; an eighth of it for complex ones.
SHARED_OUT = 1 << 18  # speed only


def product_on_one_core(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Multiply stacks of matrices (..., rows, n) and (..., n, columns) in pieces that BLAS does not divide."""
    rows, inner, columns = left.shape[-2], left.shape[-1], right.shape[-1]
    most = SHARED_OUT // 8 if "c" in (left.dtype.kind, right.dtype.kind) else SHARED_OUT
    step = max(1, most // max(inner * columns, 1))  # speed only
    if rows <= step:
        return np.asarray(left @ right)
    stack = np.broadcast_shapes(left.shape[:-2], right.shape[:-2])
    found = np.empty((*stack, rows, columns), dtype=np.result_type(left, right))
    for first in range(0, rows, step):
        np.matmul(left[..., first : first + step, :], right, out=found[..., first : first + step, :])
    return found
