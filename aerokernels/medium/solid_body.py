"""A solid body in a volume: a closed surface of triangles, points inside it, and where lines cross it.

Intersections of rays with the triangles are exact, as with the profile of a `Body`: see triangle_crossings.py.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from ..derived import Derived
from .body import Body
from .grid import as_points, check_finite
from .section import outlines
from .triangle_crossings import triangle_crossings
from .wall_tree import WallTree, wall_tree

# Direction of the lines by which `contains` decides; edges of bodies are unlikely to be parallel to it.
ASKEW = np.array([0.312_8, 0.541_7, 0.780_2]) / np.linalg.norm([0.312_8, 0.541_7, 0.780_2])
NEAREST = 3  # triangles with the nearest centroids, with which the search for the nearest one begins
PAIRS = 1 << 16  # pairs of a point and a triangle that are computed together; speed only


@dataclass(frozen=True, eq=False)
class SolidBody(Derived):
    """A solid body in a volume field, bounded by triangles.

    A point is inside where an odd number of triangles lies on one side of it: where two closed parts overlap it counts
    as outside, and a closed part within another is a cavity.

    Attributes:
        vertices: Points of the surface [m], shape (vertex_count, 3).
        triangles: Corners of each triangle, shape (triangle_count, 3). Neighbours must have the same orientation,
            outward or inward.

    Raises:
        ValueError: Shapes or indices that are not valid, points that are not finite, a surface that is not closed (the
            message says how many edges are open, and where the first is) or whose triangles differ in orientation.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    geometry: ClassVar[str] = "volume"

    def __post_init__(self):
        """Check and turn the triangles outward."""
        vertices = np.array(self.vertices, dtype=np.float64)
        triangles = np.array(self.triangles)
        if vertices.ndim != 2 or vertices.shape[1] != 3:
            raise ValueError(f"vertices of a body in a volume need shape (n, 3), got {vertices.shape}")
        if triangles.ndim != 2 or triangles.shape[1] != 3 or len(triangles) < 4:
            raise ValueError(f"a solid body needs at least four triangles, shape (n, 3), got {triangles.shape}")
        if not np.issubdtype(triangles.dtype, np.integer):
            raise ValueError(f"triangles are numbers of vertices, got dtype {triangles.dtype}")
        if triangles.min() < 0 or triangles.max() >= len(vertices):
            raise ValueError(f"triangles name vertices from {triangles.min()} to {triangles.max()} of {len(vertices)}")
        check_finite(vertices, "the body's surface")
        triangles = _outward(vertices, triangles.astype(np.int64))
        for name, value in (("vertices", vertices), ("triangles", triangles)):
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    @classmethod
    def of_revolution(cls, body: Body, count: int = 96) -> "SolidBody":
        """Return the body of an axisymmetric profile as triangles, `count` of them around the axis z.

        The vertices are on the body. Between them the surface lies inside by at most 1 - cos(pi / count) of the radius.

        Raises:
            ValueError: A planar body, or fewer than three triangles around.
        """
        if body.geometry != "axisymmetric" or count < 3:
            raise ValueError(f"a body of revolution needs an axisymmetric profile and three triangles around it or "
                             f"more, got a {body.geometry} one and {count}")  # fmt: skip
        angle = 2.0 * np.pi * np.arange(count) / count
        around = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        points, number = np.unique(np.concatenate(body.surface), axis=0, return_inverse=True)
        start, end = number.reshape(2, -1)
        on_axis = points[:, 0] == 0.0
        first = np.cumsum(np.where(on_axis, 1, count)) - np.where(on_axis, 1, count)
        rings = [
            np.array([[0.0, 0.0, z]]) if r == 0.0 else np.column_stack([r * around, np.full(count, z)])
            for r, z in points
        ]
        step, following = np.arange(count), (np.arange(count) + 1) % count

        def vertex(point: int, place: np.ndarray) -> np.ndarray:
            return first[point] + (0 if on_axis[point] else 1) * place

        made = []
        for a, b in zip(start, end, strict=True):
            corners = vertex(a, step), vertex(b, step), vertex(b, following), vertex(a, following)
            if not on_axis[b]:
                made.append(np.stack([corners[0], corners[1], corners[2]], axis=1))
            if not on_axis[a]:
                made.append(np.stack([corners[0], corners[2], corners[3]], axis=1))
        return cls(np.concatenate(rings), np.concatenate(made))

    @cached_property
    def surface(self) -> np.ndarray:
        """Corners of the triangles [m], shape (triangle_count, 3, 3), counter-clockwise seen from outside."""
        return self.vertices[self.triangles]

    @cached_property
    def tree(self) -> WallTree:
        """The tree of boxes around the triangles."""
        return wall_tree(self.surface)

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner [m]."""
        return self.vertices.min(axis=0), self.vertices.max(axis=0)

    def crossings(self, position, direction) -> np.ndarray:
        """Return distances [m] at which straight lines cross the surface: see `Body.crossings`."""
        return triangle_crossings(self.tree, position, direction)

    def contains(self, points) -> np.ndarray:
        """Return whether each point (n, 3) is inside the body."""
        points = as_points(points, 3)
        low, high = self.box
        inside = np.all((points >= low) & (points <= high), axis=1)
        rows = np.flatnonzero(inside)
        met = self.crossings(points[rows], np.broadcast_to(ASKEW, (len(rows), 3)))
        inside[rows] = np.count_nonzero(np.isfinite(met) & (met > 0.0), axis=1) % 2 == 1
        return np.asarray(inside)

    def nearest_wall(self, points) -> np.ndarray:
        """Return the exact point of the surface nearest to each point (n, 3) [m], shape (n, 3).

        The triangles with the nearest centroids give an upper bound of the distance. Of the others only those whose
        bounding boxes are nearer are evaluated.
        """
        points = as_points(points, 3)
        check_finite(points, "the points")
        if not len(points):
            return np.empty((0, 3))
        count = min(NEAREST, len(self.triangles))
        near = self._middles.query(points, count)[1].reshape(len(points), count)
        foot, least = np.empty_like(points), np.full(len(points), np.inf)
        self._replace_farther(points, foot, least, np.repeat(np.arange(len(points)), count), self.surface[near.ravel()])
        tree = self.tree
        pairs: list[tuple[np.ndarray, np.ndarray]] = []
        low, high = tree.corners.min(axis=1), tree.corners.max(axis=1)
        waiting = [(0, np.arange(len(points)))]
        while waiting:
            node, rows = waiting.pop()
            rows = rows[_squared_distances(points[rows], *tree.boxes[node]) < least[rows]]
            first, last = tree.links[node][1:]
            if len(rows) and last == first:
                waiting += tree.children(node, rows)
            elif len(rows):
                distance = _squared_distances(points[rows, None], low[first:last], high[first:last])
                row, piece = np.nonzero(distance < least[rows, None])
                pairs.append((rows[row], first + piece))
            if pairs and (not waiting or sum(len(row) for row, _ in pairs) > PAIRS):
                row, piece = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
                self._replace_farther(points, foot, least, row, tree.corners[piece])
                pairs.clear()
        return foot

    def _replace_farther(self, points, foot, least, rows, corners) -> None:
        """Replace surface points `foot` and squared distances `least`, in place, by nearer ones on triangles.

        Args:
            points: The points [m], shape (n, 3).
            foot: A point of the surface for each [m], shape (n, 3).
            least: Its squared distance [m2], shape (n,).
            rows: Number of a point for each triangle, shape (m,).
            corners: Triangles [m], shape (m, 3, 3).
        """
        for first in range(0, len(rows), PAIRS):
            part = slice(first, first + PAIRS)
            row = rows[part]
            found = _nearest_in(points[row], corners[part])
            distance = np.sum((found - points[row]) ** 2, axis=1)
            order = np.lexsort((distance, row))
            best = order[np.diff(row[order], prepend=-1) > 0]
            best = best[distance[best] < least[row[best]] * (1.0 - 1e-12)]  # feet that are equally near stay
            foot[row[best]], least[row[best]] = found[best], distance[best]

    def signed_distance(self, points) -> np.ndarray:
        """Return the distance to the surface [m], negative inside the body, at points (n, 3)."""
        distance = np.linalg.norm(points - self.nearest_wall(points), axis=1)
        return np.where(self.contains(points), -distance, distance)

    def section(self) -> np.ndarray:
        """Return the lines in which the surface crosses x = 0, as ends (y, z) of segments [m], shape (n, 2, 2)."""
        pieces = [np.stack([line, np.roll(line, -1, axis=0)], axis=1) for line in self.outlines()]
        return np.concatenate([np.empty((0, 2, 2)), *pieces])

    def outlines(self) -> list[np.ndarray]:
        """Return the closed lines in which the surface crosses x = 0, each as corners (y, z) [m], shape (n, 2)."""
        return outlines(self.vertices, self.triangles)

    @cached_property
    def _middles(self):
        from scipy.spatial import cKDTree

        return cKDTree(self.surface.mean(axis=1))


def _outward(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return the triangles, with those of each closed part oriented so that its volume is positive."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    a, b = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    count = len(vertices)
    there, back = np.sort(a * count + b), np.sort(b * count + a)
    if (there[1:] == there[:-1]).any():
        edge = int(there[:-1][there[1:] == there[:-1]][0])
        raise ValueError(
            f"triangles of the body differ in orientation, or overlap: two have the edge from vertex "
            f"{edge // count} to {edge % count} at {vertices[edge // count].tolist()} m"
        )
    open_edges = np.setdiff1d(there, back, assume_unique=True)
    if len(open_edges):
        first = int(open_edges[0])
        raise ValueError(
            f"the body's surface is not closed: {len(open_edges)} edges have one triangle, the first is at "
            f"{vertices[first // count].tolist()} m; close it, or merge its duplicate points"
        )
    part = connected_components(coo_matrix((np.ones(len(a), bool), (a, b)), shape=(count, count)), directed=False)[1]
    corner = vertices[triangles] - vertices.mean(axis=0)
    volume = np.bincount(
        part[triangles[:, 0]], np.einsum("nk,nk->n", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])), part.max() + 1
    )
    inward = volume[part[triangles[:, 0]]] < 0.0
    return np.where(inward[:, None], triangles[:, ::-1], triangles)


def _squared_distances(points: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the squared distance [m2] of points (..., 3) to boxes between two corners (..., 3); 0 inside."""
    outside = points - np.clip(points, low, high)
    return np.einsum("...k,...k->...", outside, outside)


def _nearest_in(point: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the point of each triangle (..., 3, 3) nearest to a point (..., 3).

    Source: C. Ericson, Real-Time Collision Detection.
    """
    a, ab, ac = corners[..., 0, :], corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :]

    def dot(one, other):
        return np.sum(one * other, axis=-1)

    offset = point - a
    d00, d01, d11, d20, d21 = dot(ab, ab), dot(ab, ac), dot(ac, ac), dot(offset, ab), dot(offset, ac)
    determinant = np.maximum(d00 * d11 - d01 * d01, 1e-300)
    v, w = (d11 * d20 - d01 * d21) / determinant, (d00 * d21 - d01 * d20) / determinant
    best = a + v[..., None] * ab + w[..., None] * ac
    within = (v >= 0.0) & (w >= 0.0) & (v + w <= 1.0)
    least = np.where(within, dot(best - point, best - point), np.inf)
    for k in range(3):
        one, step = corners[..., k, :], corners[..., (k + 1) % 3, :] - corners[..., k, :]
        share = np.clip(dot(point - one, step) / np.maximum(dot(step, step), 1e-300), 0.0, 1.0)
        foot = one + share[..., None] * step
        distance = np.where(within, np.inf, dot(foot - point, foot - point))
        nearer = distance < least
        best, least = np.where(nearer[..., None], foot, best), np.where(nearer, distance, least)
    return best
