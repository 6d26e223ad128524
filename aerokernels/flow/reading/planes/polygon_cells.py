"""Polygons in a plane with values: the first form of the cells of every two-dimensional file."""

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True, eq=False)
class Polygons:
    """Polygons in a plane with a value for each cell or each point.

    Attributes:
        points: Coordinates [m], shape (point_count, 2).
        start: First corner of each polygon, shape (cell_count + 1,).
        corners: Points around each polygon, concatenated.
        values: Shape (cell_count,) or (point_count,), or with a second axis: several values for each.
        where: "cell" or "point".
    """

    points: np.ndarray
    start: np.ndarray
    corners: np.ndarray
    values: np.ndarray
    where: str

    @property
    def width(self) -> np.ndarray:
        """Number of corners of each polygon."""
        return np.diff(self.start)

    def used(self) -> "Polygons":
        """Return the polygons without points that belong to no polygon."""
        kept, corners = np.unique(self.corners, return_inverse=True)
        values = self.values[kept] if self.where == "point" else self.values
        return replace(self, points=self.points[kept], corners=corners.ravel(), values=values)

    def kept(self, keep: np.ndarray) -> "Polygons":
        """Return some of the polygons."""
        corners = self.corners[np.repeat(keep, self.width)]
        start = np.concatenate([[0], np.cumsum(self.width[keep])])
        values = self.values[keep] if self.where == "cell" else self.values
        return replace(self, start=start, corners=corners, values=values).used()

    def without_repeats(self) -> "Polygons":
        """Return the polygons without corners that coincide with the previous one, as at the pole of a grid."""
        following = self.following()
        keep = (self.points[self.corners] != self.points[self.corners[following]]).any(axis=1)
        width = np.add.reduceat(keep, self.start[:-1])
        start = np.concatenate([[0], np.cumsum(width)])
        return replace(self, start=start, corners=self.corners[keep]).kept(width > 2)

    def following(self) -> np.ndarray:
        """Return the index of the next corner of the same polygon, for each corner, shape (corner_count,)."""
        following = np.arange(1, len(self.corners) + 1)
        following[self.start[1:] - 1] = self.start[:-1]
        return following
