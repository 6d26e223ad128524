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
MISSED = 1e-8  # residual of the equations
LEFT_COST = 1e3  # cost of a hard equation's residual: greater than its multiplier where it can be satisfied
NARROW = 1e-9  # variables whose bounds are closer than this are fixed
SYMMETRIC = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
FIRST, LEAST = 1e-4, 1e-15  # initial products of distance and multiplier, and least distance to a bound
FIRST_LEFT = 1e-3  # initial residual of a hard equation, as a fraction of its range
TO_BOUND = 0.995  # greatest fraction of the way to the nearest bound in one step


def least_change(
    equations, give: np.ndarray, wanted: np.ndarray, low: np.ndarray, high: np.ndarray, hard: np.ndarray | None = None
) -> np.ndarray:
    """The change x, shape (n,), within the bounds always.

    Args:
        equations: C, sparse, shape (m, n), with entries of the order of 1.
        give: e > 0 of each equation, shape (m,).
        wanted: t, shape (m,).
        low: Least change allowed, not above zero, shape (n,).
        high: Greatest change allowed, not below zero, shape (n,).
        hard: Which equations have a residual at linear cost, shape (m,); None for none.
    """
    from scipy.sparse import eye_array, hstack

    change = np.zeros(len(low))
    open_ = np.flatnonzero(high - low > NARROW)
    if not len(open_):
        return change
    matrix = equations.tocsc()[:, open_]
    low_, high_, weight, cost = low[open_], high[open_], np.ones(len(open_)), np.zeros(len(open_))
    if hard is not None and hard.any():
        left = eye_array(len(give)).tocsc()[:, np.flatnonzero(hard)]
        matrix = hstack([matrix, left, -left])
        extra = np.zeros(2 * left.shape[1])
        low_, high_ = np.concatenate([low_, extra]), np.concatenate([high_, extra + 1.0])
        weight, cost = np.concatenate([weight, extra]), np.concatenate([cost, extra + LEFT_COST])
    found = _inner_point(matrix.tocsr(), give, wanted, low_, high_, weight, cost)
    change[open_] = found[: len(open_)]
    return np.clip(change, low, high)


class _Here(NamedTuple):
    """One iterate: distances to the bounds, their multipliers, residuals, and factors of the normal equations."""

    down: np.ndarray
    up: np.ndarray
    above: np.ndarray
    below: np.ndarray
    slope: np.ndarray
    missed: np.ndarray
    weak: np.ndarray
    factors: Any


def _inner_point(matrix, give, wanted, low, high, weight, cost) -> np.ndarray:
    from scipy.sparse import diags_array
    from scipy.sparse.linalg import splu

    turned = matrix.T.tocsr()
    width, count = high - low, 2 * len(low)
    off = np.where(cost > 0.0, FIRST_LEFT, 0.1) * width
    x, y = np.clip(0.0, low + off, high - off), np.zeros(len(wanted))
    # Multipliers of residuals at a cost start at that cost, because small ones need many steps to grow.
    above, below = FIRST / (x - low) + cost, FIRST / (high - x)
    for _ in range(ITERATIONS):
        down, up = np.maximum(x - low, LEAST), np.maximum(high - x, LEAST)
        gap = float(np.sum(above * down) + np.sum(below * up)) / count
        missed = wanted - matrix @ x - give * y
        if gap < GAP and np.abs(missed).max() < MISSED:
            break
        weak = 1.0 / (weight + above / down + below / up)
        factors = splu((matrix @ diags_array(weak) @ turned + diags_array(give)).tocsc(), **SYMMETRIC)
        here = _Here(down, up, above, below, weight * x + cost - turned @ y - above + below, missed, weak, factors)
        dx, _, da, db = _direction(matrix, turned, here, 0.0, 0.0)
        way, pull = min(_far(down, dx), _far(up, -dx)), min(_far(above, da), _far(below, db))
        ahead = np.sum((above + pull * da) * (down + way * dx)) + np.sum((below + pull * db) * (up - way * dx))
        product = (ahead / count / gap) ** 3 * gap
        dx, dy, da, db = _direction(matrix, turned, here, product - da * dx, product + db * dx)
        way = min(_far(down, dx), _far(up, -dx), _far(above, da), _far(below, db))
        if not np.isfinite(way):
            break
        x, y, above, below = x + way * dx, y + way * dy, above + way * da, below + way * db
    return np.asarray(x)


def _direction(matrix, turned, here: _Here, low_product, high_product) -> tuple[np.ndarray, ...]:
    """Return Newton's step toward given products of distances and multipliers: of x, y and both multipliers."""
    down, up, above, below, slope, missed, weak, factors = here
    right = low_product / down - above - high_product / up + below - slope
    dy = factors.solve(missed - matrix @ (weak * right))
    dx = weak * (right + turned @ dy)
    return dx, dy, low_product / down - above - above / down * dx, high_product / up - below + below / up * dx


def _far(value: np.ndarray, change: np.ndarray) -> float:
    """Return the greatest fraction of a change, at most 1, along which all values stay above zero."""
    falls = change < 0.0
    return min(1.0, TO_BOUND * float(np.min(-value[falls] / change[falls]))) if falls.any() else 1.0
