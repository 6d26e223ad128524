"""Count the triangles of a closed surface on one side of points, along lines of one fixed direction.

All lines are parallel, so the triangles are projected along them once, and a plane grid lists the triangles whose
projections may reach each of its cells. A line is tested against the triangles of its own cell only, by the formulas of
triangle_crossings.py: no line passes between two triangles.
"""

from itertools import pairwise

import numpy as np

from .triangle_crossings import axes_across, edge_side

# Direction of the lines; edges of bodies are unlikely to be parallel to it.
ASKEW = np.array([0.312_8, 0.541_7, 0.780_2]) / np.linalg.norm([0.312_8, 0.541_7, 0.780_2])
PAIRS = 1 << 16  # pairs of a point and a triangle that are computed together; speed only
CELLS = 2.0  # cells of the grid for each triangle; speed only


class AskewLines:
    """The triangles with corners (m, 3, 3) [m], projected: a call counts those ahead of points (n, 3)."""

    def __init__(self, corners: np.ndarray):
        """Project the triangles, and list them by cell."""
        right, up = axes_across(ASKEW[None])
        self.axes = np.concatenate([right, up, ASKEW[None]])
        self.corners = corners @ self.axes.T
        low, high = self.corners[..., :2].min(axis=1), self.corners[..., :2].max(axis=1)
        self.origin = low.min(axis=0)
        self.side = max(1, int(np.sqrt(CELLS * len(corners))))
        self.cell = np.maximum((high.max(axis=0) - self.origin) / self.side, 1e-300)
        first, last = self._cell_of(low), self._cell_of(high)
        extent = last - first + 1
        count = extent.prod(axis=1)
        triangle = np.repeat(np.arange(len(corners)), count)
        place = np.arange(len(triangle)) - np.repeat(np.cumsum(count) - count, count)
        column, row = place // extent[triangle, 1], place % extent[triangle, 1]
        cell = (first[triangle, 0] + column) * self.side + first[triangle, 1] + row
        order = np.argsort(cell, kind="stable")
        self.listed = triangle[order]
        self.begin = np.searchsorted(cell[order], np.arange(self.side**2 + 1))

    def _cell_of(self, place: np.ndarray) -> np.ndarray:
        return np.clip(((place - self.origin) / self.cell).astype(np.int64), 0, self.side - 1)

    def count_ahead(self, points: np.ndarray) -> np.ndarray:
        """Return how many triangles lie ahead of each point along ASKEW, shape (n,)."""
        place = points @ self.axes.T
        cell = self._cell_of(place[:, :2])
        number = cell[:, 0] * self.side + cell[:, 1]
        begin, count = self.begin[number], self.begin[number + 1] - self.begin[number]
        found = np.zeros(len(points), dtype=np.int64)
        ends = np.cumsum(count)
        cuts = np.searchsorted(ends, np.arange(0, int(count.sum()) + PAIRS, PAIRS))
        for first, last in pairwise(cuts):
            rows = np.arange(first, min(last + 1, len(points)))
            found[rows] = self._ahead(place[rows], begin[rows], count[rows])
        return found

    def _ahead(self, place: np.ndarray, begin: np.ndarray, count: np.ndarray) -> np.ndarray:
        point = np.repeat(np.arange(len(place)), count)
        listed = np.arange(len(point)) - np.repeat(np.cumsum(count) - count, count) + np.repeat(begin, count)
        offset = self.corners[self.listed[listed]] - place[point][:, None]
        x, y = offset[..., 0], offset[..., 1]
        side = np.stack([edge_side(x, y, 1, 2), edge_side(x, y, 2, 0), edge_side(x, y, 0, 1)], axis=-1)
        positive = side > 0.0
        met = (positive[:, 0] == positive[:, 1]) & (positive[:, 1] == positive[:, 2])
        weight = side[met]
        ahead = np.sum(weight * offset[met][..., 2], axis=1) / np.sum(weight, axis=1) > 0.0
        return np.bincount(point[met][ahead], minlength=len(place))
