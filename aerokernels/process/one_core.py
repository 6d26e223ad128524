"""Matrix products that stay on the core that asks for them.

BLAS shares a large product out among threads of its own. Those wait for one another, and for ours: a product that one
core does in 0.1 ms takes ten times its processor time so, and rounds at the seams in another order on more cores.
"""

import numpy as np

# Multiplications of a product of real matrices up to which OpenBLAS takes one thread; of complex ones an eighth of it.
SHARED_OUT = 1 << 18  # speed only


def product_on_one_core(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Products of stacks of matrices (..., rows, n) and (..., n, columns), in pieces that BLAS does not share out."""
    rows, inner, columns = left.shape[-2], left.shape[-1], right.shape[-1]
    most = SHARED_OUT // 8 if np.iscomplexobj(left) or np.iscomplexobj(right) else SHARED_OUT
    step = max(1, most // max(inner * columns, 1))  # speed only
    if rows <= step:
        return np.asarray(left @ right)
    return np.concatenate([left[..., first : first + step, :] @ right for first in range(0, rows, step)], axis=-2)
