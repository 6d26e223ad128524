"""A solid body in the flow: its profile, and the signed distance to it on a uniform grid.

Kernels need one answer only, how far a point is from the wall and on which side. A sampled signed distance gives
that for any profile at the price of one lookup, in the same way on every backend.
"""

from dataclasses import dataclass

import numpy as np

from .grid import check_finite


@dataclass(frozen=True, eq=False)
class DistanceGrid:
    """Signed distance to a wall [m] at the nodes of a uniform grid: negative inside the body."""

    samples: np.ndarray
    origin: np.ndarray
    spacing: np.ndarray

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Bilinear signed distance [m] at local points (n, 2); the nearest edge's value outside the grid."""
        place = (points - self.origin) / self.spacing
        cell = np.clip(np.floor(place).astype(np.int64), 0, np.array(self.samples.shape) - 2)
        u, v = np.clip(place - cell, 0.0, 1.0).T
        i, j = cell.T
        s = self.samples
        near = (1 - v) * s[i, j] + v * s[i, j + 1]
        far = (1 - v) * s[i + 1, j] + v * s[i + 1, j + 1]
        return (1 - u) * near + u * far


@dataclass(frozen=True, eq=False)
class Body:
    """A solid body.

    Attributes:
        profile: Points around the body [m], in order, shape (k, 2): (y, z) or (r, z). The last joins the first; the
            part of an axisymmetric profile that lies on the axis is no wall.
        geometry: "planar" or "axisymmetric".
    """

    profile: np.ndarray
    geometry: str = "axisymmetric"

    def __post_init__(self):
        """Check the profile."""
        profile = np.array(self.profile, dtype=np.float64)
        if self.geometry not in ("planar", "axisymmetric"):
            raise ValueError(f"a body profile is 'planar' or 'axisymmetric', got {self.geometry!r}")
        if profile.ndim != 2 or profile.shape[1] != 2 or len(profile) < 3:
            raise ValueError(f"a body profile needs at least three points, shape (k, 2), got {profile.shape}")
        check_finite(profile, "the body profile")
        if self.geometry == "axisymmetric" and profile[:, 0].min() < 0.0:
            raise ValueError("an axisymmetric body profile must not have a negative radius")
        profile.setflags(write=False)
        object.__setattr__(self, "profile", profile)
        if len(self.walls[0]) == 0:
            raise ValueError("the body profile has no wall: its points all coincide, or all lie on the axis")

    @property
    def walls(self) -> tuple[np.ndarray, np.ndarray]:
        """Start and end points of the wall segments [m], each (w, 2)."""
        start, end = self.profile, np.roll(self.profile, -1, axis=0)
        keep = np.linalg.norm(end - start, axis=1) > 0.0
        if self.geometry == "axisymmetric":
            keep &= ~((start[:, 0] == 0.0) & (end[:, 0] == 0.0))
        return start[keep], end[keep]

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Whether each point (n, 2) lies inside the body (crossing number along the first axis)."""
        points = np.asarray(points, dtype=np.float64)
        # In the order of the second axis an edge straddles one stretch of the points.
        order = np.argsort(points[:, 1], kind="stable")
        first, second = points[order].T
        start, end = self.profile, np.roll(self.profile, -1, axis=0)
        from_row = np.searchsorted(second, np.minimum(start[:, 1], end[:, 1]))
        to_row = np.searchsorted(second, np.maximum(start[:, 1], end[:, 1]))
        crossed = np.zeros(len(points), dtype=bool)
        for edge in np.flatnonzero(to_row > from_row):
            (a0, a1), (b0, b1) = start[edge], end[edge]
            rows = slice(from_row[edge], to_row[edge])
            crossed[rows] ^= a0 + (second[rows] - a1) / (b1 - a1) * (b0 - a0) > first[rows]
        inside = np.empty(len(points), dtype=bool)
        inside[order] = crossed
        return inside

    def nearest_wall(self, points: np.ndarray) -> np.ndarray:
        """The wall point nearest to each point (n, 2) [m], shape (n, 2): exact, by looking at every segment."""
        points = np.asarray(points, dtype=np.float64)
        start, end = self.walls
        length = np.linalg.norm(end - start, axis=1)
        along = (end - start) / length[:, None]
        across = along[:, ::-1] * [-1.0, 1.0]
        foot = np.empty_like(points)
        # As many points at a time as stay in a processor's cache.
        block = max(1, 100_000 // len(start))
        for row in range(0, len(points), block):
            part = points[row : row + block]
            share = part @ along.T - np.sum(start * along, axis=1)
            beyond = share - np.clip(share, 0.0, length)
            beside = part @ across.T - np.sum(start * across, axis=1)
            nearest = np.argmin(beyond**2 + beside**2, axis=1)
            share = np.sum((part - start[nearest]) * along[nearest], axis=1)
            foot[row : row + block] = start[nearest] + np.clip(share, 0.0, length[nearest])[:, None] * along[nearest]
        return foot

    def signed_distance(self, points: np.ndarray) -> np.ndarray:
        """Distance to the wall [m], negative inside the body, at points (n, 2)."""
        distance = np.linalg.norm(points - self.nearest_wall(points), axis=1)
        return np.where(self.contains(points), -distance, distance)

    def distance_grid(self, low: np.ndarray, high: np.ndarray, spacing: np.ndarray) -> DistanceGrid:
        """The signed distance sampled from `low` to `high` [m]."""
        count = np.maximum(2, np.round((high - low) / spacing).astype(int) + 1)
        spacing = (high - low) / (count - 1)
        axes = [low[k] + spacing[k] * np.arange(count[k]) for k in range(2)]
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        return DistanceGrid(self.signed_distance(nodes).reshape(count), np.array(low), spacing)
