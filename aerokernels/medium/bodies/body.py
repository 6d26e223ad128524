"""A solid body in the flow, given by its profile: its surface, points inside it, and where lines cross it.

Straight lines are intersected with the segments of the profile exactly, so a body may be arbitrarily thin. A profile
may touch or cross itself: the crossing number decides what is solid, and parts of edges with solid or air on both sides
are no walls.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from aerokernels.derived import Derived
from aerokernels.display.shown import shown
from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.medium.bodies.crossings import crossings
from aerokernels.medium.bodies.wall_tree import WallTree, segment_normals, wall_tree
from aerokernels.medium.grid import as_points, check_finite

TILE_POINTS = 512  # points whose nearest walls are sought together; speed only
# Points of an axisymmetric profile nearer to the axis than this fraction of the body's size are moved onto the axis.
ON_AXIS = 1e-12
# Fractions of the body's size: the distance from an edge at which its two sides are tested, and the distance below
# which a point counts as on an edge. Both are some thousand rounding errors of a coordinate.
BESIDE = 1e-12
ON_EDGE = 1e-13
# Edges that are tested together for others that meet them.
BLOCK = 128  # speed only


@checked
@shown
@dataclass(frozen=True, eq=False)
class Body(Derived):
    """A solid body.

    Attributes:
        profile: Points around the body [m], in order, shape (k, 2): (y, z) or (r, z). The last point is joined to the
            first; segments of an axisymmetric profile on the axis are not walls.
        geometry: "planar" or "axisymmetric".
    """

    profile: np.ndarray
    geometry: str = "axisymmetric"

    if TYPE_CHECKING:  # anything that NumPy makes an array of is accepted

        def __init__(self, profile: ArrayLike, geometry: str = "axisymmetric") -> None: ...  # noqa: D107

    def __post_init__(self):
        """Check the profile."""
        profile = np.array(self.profile, dtype=np.float64)
        if self.geometry not in ("planar", "axisymmetric"):
            raise ValueError(f"a body profile is 'planar' or 'axisymmetric', got {self.geometry!r}")
        if profile.ndim != 2 or profile.shape[1] != 2 or len(profile) < 3:
            raise ValueError(f"a body profile needs at least three points, shape (k, 2), got {profile.shape}")
        check_finite(profile, "the body profile")
        if self.geometry == "axisymmetric":
            # radius * sin(pi) is not exactly zero; without this the body would have a hole along the axis.
            near_axis = np.abs(profile[:, 0]) <= ON_AXIS * np.ptp(profile, axis=0).max()
            profile[near_axis, 0] = 0.0
        if self.geometry == "axisymmetric" and profile[:, 0].min() < 0.0:
            raise ValueError("an axisymmetric body profile must not have a negative radius")
        self.set_fields(profile=profile)
        if len(self.surface[0]) == 0:
            raise ValueError("the body profile encloses nothing: give the points around a body of some thickness")

    @cached_property
    def surface(self) -> tuple[np.ndarray, np.ndarray]:
        """Start and end points [m] of the segments between air and solid, each (w, 2), with the solid on their left."""
        start, end = bounding_walls(self.profile, self.contains)
        if self.geometry == "axisymmetric":
            keep = (start[:, 0] > 0.0) | (end[:, 0] > 0.0)
            start, end = start[keep], end[keep]
        return start, end

    @property
    def normals(self) -> np.ndarray:
        """Outward unit normals at both ends of each segment of the surface, shape (w, 2, 2): see wall_tree.py."""
        return segment_normals(*self.surface, self.geometry == "axisymmetric")

    @cached_property
    def tree(self) -> WallTree:
        """The tree of boxes around the segments of the surface, for kernels."""
        return wall_tree(np.stack(self.surface, axis=1), self.normals)

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest coordinates of the profile [m]."""
        return self.profile.min(axis=0), self.profile.max(axis=0)

    @checked
    def crossings(self, position: Numbers, direction: Numbers) -> np.ndarray:
        """Return distances [m] at which straight lines cross the body's surface, ascending, shape (line_count, m).

        Exact to rounding; rows with fewer than m crossings are padded with infinity. A line starts outside, at
        infinity: it enters the body at its first, third, fifth ... crossing and leaves it at the others. Lines along x
        never cross a planar body; `contains` tells whether they are inside.

        Args:
            position: A point on each line in x, y, z [m], shape (line_count, 3) or (3,); crossings behind it have
                negative distances.
            direction: Unit vectors, shape (line_count, 3) or (3,).

        Raises:
            ValueError: Directions that are not unit vectors, or other shapes.
        """
        return crossings(*self.surface, self.geometry, position, direction)

    @checked
    def contains(self, points: Numbers) -> np.ndarray:
        """Return whether each point (n, 2) is inside the body, by the crossing number along the first axis."""
        points = as_points(points, 2)
        # Sorted by the second coordinate, the points that an edge straddles are contiguous.
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

    @checked
    def nearest_wall(self, points: Numbers) -> np.ndarray:
        """Return the exact point of the surface nearest to each point (n, 2) [m], shape (n, 2)."""
        points = as_points(points, 2)
        check_finite(points, "the points")
        foot = np.empty_like(points)
        if len(points) == 0:
            return foot
        order, first = _tiles(points)
        last = np.append(first[1:], len(points))
        low = np.minimum.reduceat(points[order], first)
        high = np.maximum.reduceat(points[order], first)
        middle, radius = 0.5 * (low + high), 0.5 * np.linalg.norm(high - low, axis=1)
        start, end = self.surface
        block = max(1, 1_000_000 // len(start))  # speed only
        for tile in range(0, len(first), block):
            part = slice(tile, tile + block)
            distance = np.sqrt(_squared_distances(middle[part], start, end))
            reach = distance.min(axis=1) + 2.0 * radius[part] * (1.0 + 1e-9)
            near = distance <= (reach * (1.0 + 1e-9))[:, None]
            for k, kept in enumerate(near, start=tile):
                rows = order[first[k] : last[k]]
                nearest = np.flatnonzero(kept)[_squared_distances(points[rows], start[kept], end[kept]).argmin(axis=1)]
                step = end[nearest] - start[nearest]
                length = np.linalg.norm(step, axis=1)
                along = step / length[:, None]
                share = np.clip(np.sum((points[rows] - start[nearest]) * along, axis=1), 0.0, length)
                foot[rows] = start[nearest] + share[:, None] * along
        return foot

    @checked
    def signed_distance(self, points: Numbers) -> np.ndarray:
        """Return the distance to the surface [m], negative inside the body, at points (n, 2)."""
        points = as_points(points, 2)
        distance = np.linalg.norm(points - self.nearest_wall(points), axis=1)
        return np.where(self.contains(points), -distance, distance)


def _tiles(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return an order of points (n, 2) by square tiles of about TILE_POINTS each, and where each tile begins in it."""
    low, extent = points.min(axis=0), np.ptp(points, axis=0)
    side = max(np.sqrt(extent.prod() * TILE_POINTS / len(points)), extent.max() * TILE_POINTS / len(points), 1e-300)
    row, column = np.floor((points - low) / side).astype(np.int64).T
    key = row * (int(column.max()) + 1) + column
    order = np.argsort(key, kind="stable")
    return order, np.flatnonzero(np.diff(key[order], prepend=-1))


def _squared_distances(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the squared distance [m2] of each point (n, 2) to each segment (w, 2), shape (n, w)."""
    length = np.linalg.norm(end - start, axis=1)
    along = (end - start) / length[:, None]
    across = along[:, ::-1] * [-1.0, 1.0]
    share = points @ along.T - np.sum(start * along, axis=1)
    beyond = share - np.clip(share, 0.0, length)
    beside = points @ across.T - np.sum(start * across, axis=1)
    return np.asarray(beyond**2 + beside**2)


def bounding_walls(profile: np.ndarray, contains) -> tuple[np.ndarray, np.ndarray]:
    """Return start and end points [m] of the segments between air and solid, each (w, 2), with the solid on their left.

    `profile` has points around the body, `contains` returns whether points (n, 2) are inside.
    """
    start, end = profile, np.roll(profile, -1, axis=0)
    keep = np.any(start != end, axis=1)
    if not keep.any():  # all points coincide
        return start[keep], end[keep]
    start, end = _split(start[keep], end[keep])
    step = end - start
    length = np.linalg.norm(step, axis=1)
    left = np.stack([-step[:, 1], step[:, 0]], axis=1) / length[:, None]
    # Points far from the origin have greater rounding errors, which the offset must exceed.
    beside = BESIDE * max(float(np.ptp(profile, axis=0).max()), 1e-2 * float(np.abs(profile).max()))
    middle = 0.5 * (start + end)
    solid_left, solid_right = contains(middle + beside * left), contains(middle - beside * left)
    start, end = np.where(solid_left[:, None], start, end), np.where(solid_left[:, None], end, start)
    both = np.concatenate([start, end], axis=1)[solid_left != solid_right]
    _, first = np.unique(both, axis=0, return_index=True)
    kept = both[np.sort(first)]  # edges that coincide are one wall
    return kept[:, :2], kept[:, 2:]


def _split(start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the edges, cut where they cross or touch each other."""
    size = max(float(np.ptp(start, axis=0).max()), 1e-2 * float(np.abs(start).max()))
    low, high = np.minimum(start, end) - ON_EDGE * size, np.maximum(start, end) + ON_EDGE * size
    pieces = []
    for first in range(0, len(start), BLOCK):
        rows = np.arange(first, min(first + BLOCK, len(start)))
        near = np.all((low <= high[rows].max(axis=0)) & (high >= low[rows].min(axis=0)), axis=1)
        others = np.flatnonzero(near)
        cuts = _cuts(start[rows], end[rows], start[others], end[others], size)
        for row, places in zip(rows, cuts, strict=True):
            # The ends stay as they are, to the last bit, because neighbours share them.
            points = [start[row], *places, end[row]]
            pieces += [(a, b) for a, b in pairwise(points) if np.any(a != b)]
    return np.array([a for a, _ in pieces]), np.array([b for _, b in pieces])


def _cuts(start, end, other_start, other_end, size: float) -> list[np.ndarray]:
    """Return, for each edge, the points in order along it at which other edges cross it or end on it."""
    step = end - start
    length = np.linalg.norm(step, axis=1)
    along = step / length[:, None]

    def place(points):
        """Return distances of points along each edge, and to its left, of shape (n, m) each."""
        offset = points[None] - start[:, None]
        beside = along[:, None, 0] * offset[..., 1] - along[:, None, 1] * offset[..., 0]
        return np.sum(offset * along[:, None], axis=2), beside

    (t1, s1), (t2, s2) = place(other_start), place(other_end)
    near = ON_EDGE * size
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = t1 + (t2 - t1) * s1 / (s1 - s2)
    crosses = (np.minimum(s1, s2) < -near) & (np.maximum(s1, s2) > near)
    inner = (crossing > near) & (crossing < length[:, None] - near) & crosses
    ends_on = (np.abs(s1) <= near) & (t1 > near) & (t1 < length[:, None] - near)
    result = []
    for row in range(len(start)):
        if not (inner[row].any() or ends_on[row].any()):
            result.append(np.empty((0, 2)))
            continue
        t = np.concatenate([crossing[row][inner[row]], t1[row][ends_on[row]]])
        points = np.concatenate([start[row] + crossing[row][inner[row], None] * along[row], other_start[ends_on[row]]])
        result.append(points[np.argsort(t, kind="stable")])
    return result
