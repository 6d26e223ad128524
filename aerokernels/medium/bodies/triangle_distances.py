"""Find the points of a surface of triangles that are nearest to points in space, exactly, in float64.

The triangles with the nearest centroids give an upper bound of each point's distance; of the others only those whose
boxes are nearer are evaluated. Source of the feet: C. Ericson, Real-Time Collision Detection (2005).
"""

import numpy as np

from aerokernels.medium.bodies.wall_tree import LEAF, WallTree

POINTS = 1 << 10  # points that descend the tree together; speed only


class NearestTriangles:
    """Find the nearest points of the triangles of a tree: a call returns them for points (n, 3) [m], shape (n, 3).

    Vectors are stored by components, because NumPy gathers from one component faster than rows of three.
    """

    def __init__(self, tree: WallTree):
        """Prepare what does not depend on the points."""
        from scipy.spatial import cKDTree

        self.links = tree.links.T.astype(np.int64)
        corners = tree.corners
        self.middles = cKDTree(corners.mean(axis=1))
        self.boxes = _columns(tree.boxes.reshape(-1, 6))
        self.own_boxes = _columns(np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1))
        a, p, q = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        r = corners[:, 2] - corners[:, 1]
        pp, pq, qq, pr, rr = (np.sum(x * y, axis=1) for x, y in ((p, p), (p, q), (q, q), (p, r), (r, r)))
        self.determinant = np.maximum(pp * qq - pq * pq, 1e-300)
        self.products = pp, pq, qq, pr, rr
        self.corner, self.edges = _columns(a), tuple(map(_columns, (p, q, r)))

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Return the nearest points of the surface [m], shape (n, 3)."""
        parts = [self._nearest(points[first : first + POINTS]) for first in range(0, len(points), POINTS)]
        return np.concatenate([np.empty((0, 3)), *parts])

    def _nearest(self, points: np.ndarray) -> np.ndarray:
        # The search begins with the triangles of the nearest centroids.
        count = min(3, len(self.determinant))
        near = self.middles.query(points, count)[1].reshape(-1)
        columns = _columns(points)
        foot, least = _columns(np.empty_like(points)), np.full(len(points), np.inf)
        self._replace_farther(columns, foot, least, np.repeat(np.arange(len(points)), count), near)
        for rows, pieces in self._nearer_boxes(columns, least):
            self._replace_farther(columns, foot, least, rows, pieces)
        return np.stack(foot, axis=1)

    def _nearer_boxes(self, points, least: np.ndarray):
        """Yield pairs of a point and a triangle whose box is nearer than the squared distance `least`, by levels.

        Pairs are in the order of the points.
        """
        after, begin, end = self.links
        rows, nodes = np.arange(len(least)), np.zeros(len(least), dtype=np.int64)
        while len(rows):
            near = _squared_distances(points, self.boxes, rows, nodes) < least[rows]
            rows, nodes = rows[near], nodes[near]
            first, last = begin[nodes], end[nodes]
            leaf = last > first
            pieces = first[leaf, None] + np.arange(LEAF)
            inside = pieces < last[leaf, None]
            row, piece = np.repeat(rows[leaf], LEAF)[inside.ravel()], pieces[inside]
            near = _squared_distances(points, self.own_boxes, row, piece) < least[row]
            if near.any():
                yield row[near], piece[near]
            rows, nodes = np.repeat(rows[~leaf], 2), nodes[~leaf] + 1
            nodes = np.stack([nodes, after[nodes]], axis=1).reshape(-1)

    def _replace_farther(self, points, foot, least, rows, pieces) -> None:
        """Replace surface points `foot` and squared distances `least`, in place, by nearer ones on triangles."""
        at = [one.take(rows) for one in points]
        found = self._foot(at, pieces)
        distance = _squares([one - other for one, other in zip(found, at, strict=True)])
        first = np.flatnonzero(np.diff(rows, prepend=-1))
        nearest = np.repeat(np.minimum.reduceat(distance, first), np.diff(first, append=len(rows)))
        best = np.flatnonzero((distance == nearest) & (distance < least[rows] * (1.0 - 1e-12)))
        best = best[np.diff(rows[best], prepend=-1) > 0]  # feet that are equally near stay
        least[rows[best]] = distance[best]
        for one, other in zip(foot, found, strict=True):
            one[rows[best]] = other[best]

    def _foot(self, point, piece: np.ndarray) -> list[np.ndarray]:
        """Return the point of each triangle (m,) nearest to a point, both by component, shapes (m,)."""
        corner = [one.take(piece) for one in self.corner]
        offset = [one - other for one, other in zip(point, corner, strict=True)]
        p, q, r = ([one.take(piece) for one in edge] for edge in self.edges)
        po, qo, ro = (sum(one * other for one, other in zip(edge, offset, strict=True)) for edge in (p, q, r))
        pp, pq, qq, pr, rr = (known.take(piece) for known in self.products)
        determinant = self.determinant.take(piece)
        v, w = (qq * po - pq * qo) / determinant, (pp * qo - pq * po) / determinant
        outside = np.flatnonzero((v < 0.0) | (w < 0.0) | (v + w > 1.0))
        pp, qq, pr, rr, po, qo, ro = (known[outside] for known in (pp, qq, pr, rr, po, qo, ro))
        on_p, on_q, on_r = _share(po, pp), _share(qo, qq), _share(ro - pr, rr)
        # Squared distances from the feet on the edges, less that from a; p + on_r r is the foot on the third edge.
        to_p, to_q = on_p * (on_p * pp - 2.0 * po), on_q * (on_q * qq - 2.0 * qo)
        to_r = pp - 2.0 * po + on_r * (on_r * rr - 2.0 * (ro - pr))
        by_p, by_r = (to_p <= to_q) & (to_p <= to_r), to_r < to_q
        v[outside] = np.where(by_p, on_p, np.where(by_r, 1.0 - on_r, 0.0))
        w[outside] = np.where(by_p, 0.0, np.where(by_r, on_r, on_q))
        return [a + v * one + w * other for a, one, other in zip(corner, p, q, strict=True)]


def _columns(rows: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the components of vectors (n, k) as k contiguous arrays (n,)."""
    return tuple(np.ascontiguousarray(rows.T))


def _squares(vector) -> np.ndarray:
    """Return the squares of vectors that are given by component."""
    return np.asarray(sum(one * one for one in vector))


def _share(product: np.ndarray, square: np.ndarray) -> np.ndarray:
    """Return the place of a foot along an edge, between 0 and 1."""
    return np.clip(product / np.maximum(square, 1e-300), 0.0, 1.0)


def _squared_distances(points, boxes, rows: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Return the squared distances [m2] of points to boxes, of which `rows` and `numbers` are pairs; 0 inside."""
    total = np.zeros(len(rows))
    for axis, coordinate in enumerate(points):
        at = coordinate.take(rows)
        outside = np.maximum(boxes[axis].take(numbers) - at, at - boxes[axis + 3].take(numbers))
        np.maximum(outside, 0.0, out=outside)
        total += outside * outside
    return total
