r"""The Runge-Kutta-Nystrom pair that moves every ray: r'' = n grad n, r' = T = n dr/ds, d sigma = ds / n, |T| = n.

Order 4 in r and T with an embedded order 3; the last of four stages is the first of the next step. Quantities with
Q' = f(r) (optical path, arc length) take the weights of T. Formula RKN4(3)4FM of J. R. Dormand, M. E. A. El-Mikkawy,
P. J. Prince, IMA J. Numer. Anal. 7 (1987) 235.
"""

import numpy as np

# Nodes, the matrix of the stages, and the weights of position and momentum.
C = np.array([0.0, 1 / 4, 7 / 10, 1.0])
A = np.array(
    [[0.0, 0.0, 0.0, 0.0], [1 / 32, 0.0, 0.0, 0.0], [7 / 1000, 119 / 500, 0.0, 0.0], [1 / 14, 8 / 27, 25 / 189, 0.0]]
)
B = np.array([1 / 14, 8 / 27, 25 / 189, 0.0])
BT = np.array([1 / 14, 32 / 81, 250 / 567, 5 / 54])
# Less those of the embedded formula: position -7/150, 67/150, 3/20, -1/20, momentum 13/21, -20/27, 275/189, -1/3.
B_ERROR = np.array([62 / 525, -203 / 1350, -67 / 3780, 1 / 20])
BT_ERROR = np.array([-23 / 42, 92 / 81, -575 / 567, 23 / 54])
# Rate of change at the end of a step, per step, of the parabola through the forces at the first, third and last stage.
END_RATE = np.array([(1.0 - C[2]) / C[2], 0.0, -1.0 / (C[2] * (1.0 - C[2])), (2.0 - C[2]) / (1.0 - C[2])])
# Weights [i, j] of the value at node j in the integral from 0 to node i of the cubic through all values: of the
# momentum at the stages, for sums over a step that need it there.
STAGE_MOMENTUM = np.array(
    [
        [0.0, 0.0, 0.0, 0.0],
        [13 / 128, 215 / 1296, -125 / 5184, 23 / 3456],
        [7 / 125, 4459 / 10125, 371 / 1620, -343 / 13500],
        [1 / 14, 32 / 81, 250 / 567, 5 / 54],
    ]
)
# The optical path's rule against the rule that also takes the slopes along the ray and is exact to degree 7: a sharp
# estimate of the rule's error, of the same order. The embedded formula's estimate is two orders too careful.
PATH_ERROR_VALUE = BT - np.array([3677 / 24010, 230912 / 688905, 17525000 / 47258883, 7187 / 51030])
PATH_ERROR_SLOPE = -np.array([9 / 1372, 1664 / 76545, -5000 / 750141, -199 / 34020])
# Up to this angle with the first direction [rad] the deviation along it is summed like the path (kernels/trace.py).
NEARLY_STRAIGHT = 1e-2


def has_consistent_gradient(interpolation: str) -> bool:
    """Whether index and gradient come from one interpolant; if not, as in the paper's schemes, |T| = n is violated."""
    return interpolation not in ("bilinear-barron", "idw")
