r"""Smallest change within bounds that satisfies sparse linear equations, with a penalty for violating them.

    minimise  |x|^2 / 2 + sum_k y_k^2 e_k / 2    with  C x + e y = t,  low <= x <= high

The residual of equation k is e_k y_k, so an equation with a small e is satisfied wherever the bounds permit, and one
with a greater e is violated more readily, at a quadratic cost. If the bounds make several equations incompatible, a
quadratic cost spreads the residual over all of them. Equations marked `hard` therefore have a residual at linear cost,
which violates few of them and satisfies the rest.

Method: Mehrotra's predictor-corrector interior-point method (SIAM J. Optim. 2 (1992) 575) on the normal equations, with
one sparse factorisation per iteration, about 10 to 25 of them.
"""

from typing import Any, NamedTuple

import numpy as np

ITERATIONS = 50  # at most
GAP = 1e-13  # mean product of a distance to a bound and its multiplier; the error of a value at a bound is its root
RESIDUAL = 1e-8  # greatest residual of the equations at the end
RESIDUAL_COST = 1e3  # cost of a hard equation's residual: greater than its multiplier where it can be satisfied
FIXED = 1e-9  # variables whose bounds are closer than this are fixed
SYMMETRIC = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
FIRST_PRODUCT = 1e-4  # initial product of the distance to a bound and its multiplier
LEAST_DISTANCE = 1e-15  # to a bound
FIRST_RESIDUAL = 1e-3  # initial residual of a hard equation, as a fraction of its range
TO_BOUND = 0.995  # greatest fraction of the way to the nearest bound in one step


def least_change(
    equations,
    compliance: np.ndarray,
    target: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    hard: np.ndarray | None = None,
) -> np.ndarray:
    """The change x, shape (n,), within the bounds always.

    Args:
        equations: C, sparse, shape (m, n), with entries of the order of 1.
        compliance: e > 0 of each equation, shape (m,).
        target: t, shape (m,).
        low: Least change allowed, not above zero, shape (n,).
        high: Greatest change allowed, not below zero, shape (n,).
        hard: Which equations have a residual at linear cost, shape (m,); None for none.
    """
    from scipy.sparse import eye_array, hstack

    change = np.zeros(len(low))
    free = np.flatnonzero(high - low > FIXED)
    if not len(free):
        return change
    matrix = equations.tocsc()[:, free]
    low_, high_, weight, cost = low[free], high[free], np.ones(len(free)), np.zeros(len(free))
    if hard is not None and hard.any():
        slack = eye_array(len(compliance)).tocsc()[:, np.flatnonzero(hard)]
        matrix = hstack([matrix, slack, -slack])
        extra = np.zeros(2 * slack.shape[1])
        low_, high_ = np.concatenate([low_, extra]), np.concatenate([high_, extra + 1.0])
        weight, cost = np.concatenate([weight, extra]), np.concatenate([cost, extra + RESIDUAL_COST])
    found = _inner_point(matrix.tocsr(), compliance, target, low_, high_, weight, cost)
    change[free] = found[: len(free)]
    return np.clip(change, low, high)


class _Iterate(NamedTuple):
    """One iterate: distances to the bounds, their multipliers, residuals, and factors of the normal equations."""

    down: np.ndarray
    up: np.ndarray
    above: np.ndarray
    below: np.ndarray
    slope: np.ndarray
    residual: np.ndarray
    inverse: np.ndarray
    factors: Any


def _inner_point(matrix, compliance, target, low, high, weight, cost) -> np.ndarray:
    from scipy.sparse import diags_array
    from scipy.sparse.linalg import splu

    transposed = matrix.T.tocsr()
    width, count = high - low, 2 * len(low)
    off = np.where(cost > 0.0, FIRST_RESIDUAL, 0.1) * width
    x, y = np.clip(0.0, low + off, high - off), np.zeros(len(target))
    # Multipliers of residuals at a cost start at that cost, because small ones need many steps to grow.
    above, below = FIRST_PRODUCT / (x - low) + cost, FIRST_PRODUCT / (high - x)
    for _ in range(ITERATIONS):
        down, up = np.maximum(x - low, LEAST_DISTANCE), np.maximum(high - x, LEAST_DISTANCE)
        gap = float(np.sum(above * down) + np.sum(below * up)) / count
        residual = target - matrix @ x - compliance * y
        if gap < GAP and np.abs(residual).max() < RESIDUAL:
            break
        inverse = 1.0 / (weight + above / down + below / up)
        factors = splu((matrix @ diags_array(inverse) @ transposed + diags_array(compliance)).tocsc(), **SYMMETRIC)
        slope = weight * x + cost - transposed @ y - above + below
        iterate = _Iterate(down, up, above, below, slope, residual, inverse, factors)
        dx, _, da, db = _direction(matrix, transposed, iterate, 0.0, 0.0)
        primal = min(_step_length(down, dx), _step_length(up, -dx))
        dual = min(_step_length(above, da), _step_length(below, db))
        predicted = np.sum((above + dual * da) * (down + primal * dx))
        predicted += np.sum((below + dual * db) * (up - primal * dx))
        product = (predicted / count / gap) ** 3 * gap
        dx, dy, da, db = _direction(matrix, transposed, iterate, product - da * dx, product + db * dx)
        length = min(_step_length(down, dx), _step_length(up, -dx), _step_length(above, da), _step_length(below, db))
        if not np.isfinite(length):
            break
        x, y, above, below = x + length * dx, y + length * dy, above + length * da, below + length * db
    return np.asarray(x)


def _direction(matrix, transposed, iterate: _Iterate, low_product, high_product) -> tuple[np.ndarray, ...]:
    """Return Newton's step toward given products of distances and multipliers: of x, y and both multipliers."""
    down, up, above, below, slope, residual, inverse, factors = iterate
    right = low_product / down - above - high_product / up + below - slope
    dy = factors.solve(residual - matrix @ (inverse * right))
    dx = inverse * (right + transposed @ dy)
    return dx, dy, low_product / down - above - above / down * dx, high_product / up - below + below / up * dx


def _step_length(value: np.ndarray, change: np.ndarray) -> float:
    """Return the greatest fraction of a change, at most 1, along which all values stay above zero."""
    falls = change < 0.0
    return min(1.0, TO_BOUND * float(np.min(-value[falls] / change[falls]))) if falls.any() else 1.0
