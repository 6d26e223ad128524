"""A solid body in a volume: a closed surface of triangles, points inside it, and where lines cross it.

A point is inside by the number of triangles ahead of it along one fixed direction, found by bins of their projections.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from aerokernels.derived import Derived
from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.inputs.checks import check_count
from aerokernels.medium.bodies.body import Body
from aerokernels.medium.bodies.crossings import axes_across, edge_side, triangle_crossings
from aerokernels.medium.bodies.wall_tree import NearestTriangles, WallTree, triangle_normals, wall_tree
from aerokernels.medium.grid import as_points, check_finite
from aerokernels.medium.mesh_cells import Bins, bins_of

# Direction of the lines; edges of bodies are unlikely to be parallel to it.
ASKEW = np.array([0.312_8, 0.541_7, 0.780_2]) / np.linalg.norm([0.312_8, 0.541_7, 0.780_2])


@checked
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
        self.set_fields(vertices=vertices, triangles=_outward(vertices, triangles.astype(np.int64)))

    @classmethod
    @checked
    def of_revolution(cls, body: Body, count: int = 96) -> "SolidBody":
        """Return the body of an axisymmetric profile as triangles, `count` of them around the axis z.

        The vertices are on the body. Between them the surface lies inside by at most 1 - cos(pi / count) of the radius.

        Raises:
            ValueError: A planar body, or fewer than three triangles around.
        """
        count = check_count(count, "count", 3)
        if body.geometry != "axisymmetric":
            raise ValueError(f"a body of revolution needs an axisymmetric profile, got a {body.geometry} one")
        angle = 2.0 * np.pi * np.arange(count) / count
        around = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        ends = np.stack(body.surface)[..., None, :]
        rings = np.concatenate(
            [ends[..., :1] * around, np.broadcast_to(ends[..., 1:], (*ends.shape[:2], count, 1))], axis=-1
        )
        (a, b), (a_next, b_next) = rings + 0.0, np.roll(rings, -1, axis=2) + 0.0  # no negative zeros
        corners = np.concatenate([np.stack([a, b, b_next], axis=2), np.stack([a, b_next, a_next], axis=2)])
        vertices, number = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
        triangles = number.reshape(-1, 3)
        whole = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)  # those at the axis have two corners in one
        return cls(vertices, triangles[whole])

    @cached_property
    def surface(self) -> np.ndarray:
        """Corners of the triangles [m], shape (triangle_count, 3, 3), counter-clockwise seen from outside."""
        return self.vertices[self.triangles]

    @property
    def normals(self) -> np.ndarray:
        """Outward unit normals at the corners of each triangle, shape (triangle_count, 3, 3): see wall_tree.py."""
        return triangle_normals(self.surface, self.triangles)

    @cached_property
    def tree(self) -> WallTree:
        """The tree of boxes around the triangles."""
        return wall_tree(self.surface, self.normals)

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner [m]."""
        return self.vertices.min(axis=0), self.vertices.max(axis=0)

    @checked
    def crossings(self, position: Numbers, direction: Numbers) -> np.ndarray:
        """Return distances [m] at which straight lines cross the surface: see `Body.crossings`."""
        return triangle_crossings(self.tree, position, direction)

    @checked
    def contains(self, points: Numbers) -> np.ndarray:
        """Return whether each point (n, 3) is inside the body."""
        points = as_points(points, 3)
        axes, corners, bins = self._projected
        low, high = self.box
        rows = np.flatnonzero(np.all((points >= low) & (points <= high), axis=1))
        place, ahead = points[rows] @ axes.T, np.zeros(len(rows), dtype=np.int64)
        for row, triangle in bins.pairs(np.ascontiguousarray(place[:, :2])):
            offset = corners[triangle] - place[row][:, None]
            x, y = offset[..., 0], offset[..., 1]
            side = np.stack([edge_side(x, y, 1, 2), edge_side(x, y, 2, 0), edge_side(x, y, 0, 1)], axis=-1)
            positive = side > 0.0
            met = (positive[:, 0] == positive[:, 1]) & (positive[:, 1] == positive[:, 2])
            weight = side[met]
            in_front = np.sum(weight * offset[met][..., 2], axis=1) / np.sum(weight, axis=1) > 0.0
            ahead += np.bincount(row[met][in_front], minlength=len(rows))
        inside = np.zeros(len(points), bool)
        inside[rows] = ahead % 2 == 1
        return inside

    @checked
    def nearest_wall(self, points: Numbers) -> np.ndarray:
        """Return the exact point of the surface nearest to each point (n, 3) [m], shape (n, 3)."""
        points = as_points(points, 3)
        check_finite(points, "the points")
        return self._nearest(points)

    @checked
    def signed_distance(self, points: Numbers) -> np.ndarray:
        """Return the distance to the surface [m], negative inside the body, at points (n, 3)."""
        points = as_points(points, 3)
        distance = np.linalg.norm(points - self.nearest_wall(points), axis=1)
        return np.where(self.contains(points), -distance, distance)

    def outlines(self) -> list[np.ndarray]:
        """Return the closed lines in which the surface crosses x = 0, each as corners (y, z) [m], shape (n, 2)."""
        return outlines(self.vertices, self.triangles)

    @cached_property
    def _projected(self) -> tuple[np.ndarray, np.ndarray, Bins]:
        """Two axes across ASKEW and itself, the triangles' corners along these, and bins over their projections."""
        axes = np.concatenate([*axes_across(ASKEW[None]), ASKEW[None]])
        corners = self.surface @ axes.T
        low, high = (end(corners[..., :2], axis=1).T.copy() for end in (np.min, np.max))
        origin = low.min(axis=1)
        return axes, corners, bins_of(low, high, origin, high.max(axis=1) - origin)

    @cached_property
    def _nearest(self) -> NearestTriangles:
        return NearestTriangles(self.tree)


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


def outlines(vertices: np.ndarray, triangles: np.ndarray) -> list[np.ndarray]:
    """Return the closed lines in which a surface crosses the plane x = 0, each as its corners (y, z) [m], shape (n, 2).

    A vertex on the plane counts as lying on its negative side, so that the lines are closed for any surface.
    """
    above = vertices[:, 0] > 0.0
    side = above[triangles]
    cut = triangles[side.any(axis=1) & ~side.all(axis=1)]
    if not len(cut):
        return []
    # Each triangle that is cut joins its two crossed edges.
    edges = np.sort(np.stack([cut, np.roll(cut, -1, axis=1)], axis=-1), axis=-1)  # (cut, 3, 2)
    crossed = above[edges[..., 0]] != above[edges[..., 1]]
    named, number = np.unique(edges[crossed], axis=0, return_inverse=True)
    joined = number.reshape(-1, 2)
    one, other = vertices[named[:, 0]], vertices[named[:, 1]]
    share = one[:, 0] / (one[:, 0] - other[:, 0])
    place = (one + share[:, None] * (other - one))[:, 1:]
    neighbours: list[list[int]] = [[] for _ in named]
    for a, b in joined.tolist():
        neighbours[a].append(b)
        neighbours[b].append(a)
    result, left = [], set(range(len(named)))
    while left:
        line = [left.pop()]
        while onward := [k for k in neighbours[line[-1]] if k in left]:
            line.append(onward[0])
            left.remove(onward[0])
        result.append(place[line])
    return result
