"""Recognise a wedge: the cells between two planes through an axis that stand for a flow of revolution."""

from dataclasses import dataclass

import numpy as np

GREATEST_ANGLE = 0.35  # [rad] 20 degrees
LEAST_ANGLE = 1e-4
ON_AXIS = 1e-6  # of the greatest radius
ON_PLANE = 1e-3  # of the wedge's angle: single precision
SOME_POINTS = 1000


@dataclass(frozen=True, eq=False)
class Layers:
    """Two layers of points with cells between them.

    Attributes:
        places: Where points are along the layers, shape (n, 2).
        low: Which points are in the lower layer, shape (n,).
        high: Which are in the upper one; points on the axis of a wedge are in both.
    """

    places: np.ndarray
    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True, eq=False)
class Wedge:
    """A wedge that is one cell thick, about an axis through the origin.

    Attributes:
        axis: Number of the axis in the file: 0, 1 or 2.
        ahead: Direction between its planes, of the two other coordinates, shape (2,).
        low: Angle of one of its planes from it [rad].
        high: Angle of the other one [rad].
        radius: Greatest distance of its points from the axis.
    """

    axis: int
    ahead: np.ndarray
    low: float
    high: float
    radius: float

    @property
    def angle(self) -> float:
        """Angle between the planes [rad]."""
        return self.high - self.low

    def layers(self, points: np.ndarray) -> Layers:
        """Return its two layers among points, shape (n, 3): along the axis and from it, in the file's unit."""
        one, other = (points[:, k] for k in range(3) if k != self.axis)
        beside = np.hypot(one, other)
        turn = _turn(one, other, self.ahead)
        on_axis = beside <= ON_AXIS * self.radius
        near = ON_PLANE * self.angle
        return Layers(
            np.stack([points[:, self.axis], beside], axis=1),
            on_axis | (turn - self.low < near),
            on_axis | (self.high - turn < near),
        )


def wedge(points: np.ndarray) -> Wedge | None:
    """Return the wedge of which points are the corners of the cells; None for other points.

    Args:
        points: Points of a volume in the file's axes, shape (n, 3).
    """
    for axis in range(3):
        some = points[:: max(len(points) // SOME_POINTS, 1)]
        if _wedge(some, axis) is not None and (found := _wedge(points, axis)) is not None:
            return found
    return None


def _wedge(points: np.ndarray, axis: int) -> Wedge | None:
    """Return the wedge of two planes through an axis that hold all points; None if there are no such planes."""
    one, other = (points[:, k] for k in range(3) if k != axis)
    beside = np.hypot(one, other)
    radius = float(beside.max(initial=0.0))
    off = beside > ON_AXIS * radius
    if off.sum() < 2:
        return None
    one, other = one[off], other[off]
    ahead = np.array([one.sum(), other.sum()])
    turn = _turn(one, other, ahead)
    low, high = float(turn.min()), float(turn.max())
    if not LEAST_ANGLE < high - low <= GREATEST_ANGLE:
        return None
    near = np.minimum(turn - low, high - turn) < ON_PLANE * (high - low)
    return Wedge(axis, ahead, low, high, radius) if near.all() else None


def _turn(one: np.ndarray, other: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    """Return the angles of points about an axis, from the direction `ahead` [rad]."""
    return np.asarray(np.arctan2(one * -ahead[1] + other * ahead[0], one * ahead[0] + other * ahead[1]))
