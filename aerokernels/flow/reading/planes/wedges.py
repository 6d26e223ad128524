"""Recognise a wedge: the cells between two planes through an axis that stand for a flow of revolution."""

import numpy as np

GREATEST_ANGLE = 0.35  # [rad] 20 degrees
LEAST_ANGLE = 1e-4
ON_PLANE = 1e-3  # of the wedge's angle: single precision
SOME_POINTS = 1000


def wedge(points: np.ndarray) -> tuple[str, float] | None:
    """Return the axis ("x", "y" or "z") and the angle [rad] of a wedge that is one cell thick; None for other points.

    Args:
        points: Points of a volume in the file's axes, shape (n, 3).
    """
    for axis, name in enumerate("xyz"):
        some = points[:: max(len(points) // SOME_POINTS, 1)]
        if _angle(some, axis) is not None and (angle := _angle(points, axis)) is not None:
            return name, angle
    return None


def _angle(points: np.ndarray, axis: int) -> float | None:
    """Return the angle between two planes through an axis that hold all points; None if there are no such planes."""
    one, other = (points[:, k] for k in range(3) if k != axis)
    beside = np.hypot(one, other)
    off = beside > 1e-6 * beside.max(initial=0.0)
    if off.sum() < 2:
        return None
    one, other = one[off], other[off]
    ahead = np.array([one.sum(), other.sum()])
    turn = np.arctan2(one * -ahead[1] + other * ahead[0], one * ahead[0] + other * ahead[1])
    low, high = float(turn.min()), float(turn.max())
    if not LEAST_ANGLE < high - low <= GREATEST_ANGLE:
        return None
    near = np.minimum(turn - low, high - turn) < ON_PLANE * (high - low)
    return high - low if near.all() else None
