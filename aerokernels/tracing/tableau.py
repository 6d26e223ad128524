r"""The Runge-Kutta-Nystrom pair that moves every ray.

    r'' = D(r) = n grad n,  r' = T = n dr/ds,  d sigma = ds / n,   |T| = n

Order 4 in r and T with an embedded order 3, four stages of which the last is the first of the next step: three field
evaluations a step. Quantities with Q' = f(r) (optical path, arc length) take the weights of T.

Reference: J. R. Dormand, M. E. A. El-Mikkawy, P. J. Prince, Families of Runge-Kutta-Nystrom formulae, IMA J. Numer.
Anal. 7 (1987) 235, formula RKN4(3)4FM.
"""

from dataclasses import dataclass
from fractions import Fraction as F

import numpy as np


@dataclass(frozen=True)
class NystromPair:
    """Nodes `c`, stage matrix `a`, weights for position `b`, for momentum `bt`, and those of the embedded formula."""

    c: tuple
    a: tuple
    b: tuple
    bt: tuple
    b_low: tuple
    bt_low: tuple

    def __post_init__(self):
        """Check the order conditions, so that a mistyped number cannot pass."""
        for weight, momentum, order in ((self.b, self.bt, 4), (self.b_low, self.bt_low, 3)):
            for power in range(order):
                if sum(w * c**power for w, c in zip(momentum, self.c, strict=True)) != F(1, power + 1):
                    raise ValueError(f"momentum weights fail the order condition of c^{power}")
            for power in range(order - 1):
                expected = F(1, (power + 1) * (power + 2))
                if sum(w * c**power for w, c in zip(weight, self.c, strict=True)) != expected:
                    raise ValueError(f"position weights fail the order condition of c^{power}")
        for row, c in zip(self.a, self.c, strict=True):
            if sum(row) != c * c / 2:
                raise ValueError(f"the stage at c = {c} is not consistent")
        if tuple(self.a[-1]) != tuple(self.b):
            raise ValueError("the last stage must be the new point")


PAIR = NystromPair(
    c=(F(0), F(1, 4), F(7, 10), F(1)),
    a=(
        (F(0), F(0), F(0), F(0)),
        (F(1, 32), F(0), F(0), F(0)),
        (F(7, 1000), F(119, 500), F(0), F(0)),
        (F(1, 14), F(8, 27), F(25, 189), F(0)),
    ),
    b=(F(1, 14), F(8, 27), F(25, 189), F(0)),
    bt=(F(1, 14), F(32, 81), F(250, 567), F(5, 54)),
    b_low=(F(-7, 150), F(67, 150), F(3, 20), F(-1, 20)),
    bt_low=(F(13, 21), F(-20, 27), F(275, 189), F(-1, 3)),
)

C = np.array([float(v) for v in PAIR.c])
A = np.array([[float(v) for v in row] for row in PAIR.a])
B = np.array([float(v) for v in PAIR.b])
BT = np.array([float(v) for v in PAIR.bt])
B_ERROR = np.array([float(v - w) for v, w in zip(PAIR.b, PAIR.b_low, strict=True)])
BT_ERROR = np.array([float(v - w) for v, w in zip(PAIR.bt, PAIR.bt_low, strict=True)])
# Rate of change at the end of a step, per step, of the parabola through the forces at the first, third and last stage.
END_RATE = np.array([(1.0 - C[2]) / C[2], 0.0, -1.0 / (C[2] * (1.0 - C[2])), (2.0 - C[2]) / (1.0 - C[2])])
# Up to this angle with the first direction [rad] the deviation along it is summed like the path (kernels/trace.py).
NEARLY_STRAIGHT = 1e-2


def has_consistent_gradient(interpolation: str) -> bool:
    """Whether index and gradient come from one interpolant; if not, as in the paper's schemes, |T| = n is violated."""
    return interpolation not in ("bilinear-barron", "idw")


def hermite_weights(nodes: tuple) -> tuple[np.ndarray, np.ndarray]:
    """Weights of values and of slopes at `nodes` in [0, 1] that integrate polynomials of degree 2 n - 1 exactly."""
    count = len(nodes)
    matrix = [[c**k for c in nodes] + [k * c ** max(k - 1, 0) for c in nodes] for k in range(2 * count)]
    weight = _solve(matrix, [F(1, k + 1) for k in range(2 * count)])
    return np.array([float(v) for v in weight[:count]]), np.array([float(v) for v in weight[count:]])


def _solve(matrix: list[list[F]], right: list[F]) -> list[F]:
    """Gauss-Jordan elimination in rational numbers."""
    rows = [[*row, value] for row, value in zip(matrix, right, strict=True)]
    for column in range(len(rows)):
        pivot = next(k for k in range(column, len(rows)) if rows[k][column] != 0)
        rows[column], rows[pivot] = rows[pivot], rows[column]
        rows[column] = [v / rows[column][column] for v in rows[column]]
        for k, row in enumerate(rows):
            if k != column and row[column] != 0:
                rows[k] = [v - row[column] * w for v, w in zip(row, rows[column], strict=True)]
    return [row[-1] for row in rows]


def stage_integrals(nodes: tuple) -> np.ndarray:
    """Weights [i, j] of the value at node j in the integral from 0 to node i of the cubic through all values."""
    count = len(nodes)
    moments = [[c**k for c in nodes] for k in range(count)]
    rows = [_solve(moments, [end ** (k + 1) / (k + 1) for k in range(count)]) for end in nodes]
    return np.array([[float(v) for v in row] for row in rows])


# Weights of the momentum at the stages, for sums over a step that need it there.
STAGE_MOMENTUM = stage_integrals(PAIR.c)
# The optical path's rule against the rule that also takes the slopes along the ray and is exact to degree 7: a sharp
# estimate of the rule's error, of the same order. The embedded formula's estimate is two orders too careful.
_VALUE, _SLOPE = hermite_weights(PAIR.c)
PATH_ERROR_VALUE = BT - _VALUE
PATH_ERROR_SLOPE = -_SLOPE
