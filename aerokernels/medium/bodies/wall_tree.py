"""The surface of a body for kernels: segments of a profile, or triangles, in a tree of bounding boxes.

Nodes are in depth-first order, with a link to the node that follows if a box is missed: kernels need no stack. Normals
at the corners are those of the circle through three corners, at an angle a L / (L0 + L) off the second of two chords
that turn by a. Corners that turn by more than SMOOTH are edges of the body.
"""

from dataclasses import dataclass

import numpy as np

# Most pieces of a leaf.
LEAF = 4  # speed only
# Margin of the boxes around their pieces, as a fraction of the body's size: some million rounding errors.
MARGIN = 1e-9
SMOOTH = np.radians(10.0)
CORNERS = 1 << 18  # corners of triangles whose neighbours are in memory together; speed only


@dataclass(frozen=True, eq=False)
class WallTree:
    """Pieces of a surface and their bounding boxes; corners have d coordinates: (r, z), (y, z) or (x, y, z) [m].

    Segments have the solid on their left, triangles are counter-clockwise seen from outside. Each node is linked to the
    next one after all its descendants, and a leaf to its first piece and the one after its last.
    """

    corners: np.ndarray  # of each piece, shape (w, d, d)
    normals: np.ndarray  # outward unit normals there, linear between them, shape (w, d, d)
    boxes: np.ndarray  # lowest and highest corner of each node's box [m], shape (n, 2, d)
    links: np.ndarray  # shape (n, 3)

    @property
    def kernel_rows(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Corners, normals and boxes as kernels take them, in rows of four numbers; in space padded with a zero."""
        all_rows = self.corners, self.normals, self.boxes
        if self.corners.shape[-1] == 2:
            return tuple(rows.reshape(-1, 4) for rows in all_rows)  # type: ignore[return-value]
        return tuple(np.pad(rows.reshape(-1, 3), ((0, 0), (0, 1))) for rows in all_rows)  # type: ignore[return-value]


def wall_tree(corners: np.ndarray, normals: np.ndarray) -> WallTree:
    """Return the tree of pieces with corners [m] and normals there, each of shape (w, d, d)."""
    low, high = corners.min(axis=1), corners.max(axis=1)
    middle = 0.5 * (low + high)
    margin = MARGIN * float((high.max(axis=0) - low.min(axis=0)).max())
    boxes: list[np.ndarray] = []
    links: list[list[int]] = []
    order: list[np.ndarray] = []
    placed = 0
    # A stack of rows that need a node, or of the number of a node whose descendants are complete.
    waiting: list[np.ndarray | int] = [np.arange(len(corners))]
    while waiting:
        rows = waiting.pop()
        if isinstance(rows, int):
            links[rows][0] = len(links)
            continue
        number = len(links)
        boxes.append(np.stack([low[rows].min(axis=0) - margin, high[rows].max(axis=0) + margin]))
        if len(rows) <= LEAF:
            links.append([number + 1, placed, placed + len(rows)])
            order.append(rows)
            placed += len(rows)
            continue
        links.append([0, 0, 0])
        axis = int(np.argmax(np.ptp(middle[rows], axis=0)))
        rows = rows[np.argsort(middle[rows, axis], kind="stable")]
        # The first side gets a whole number of full leaves.
        half = LEAF * max(1, round(len(rows) / (2 * LEAF)))
        half = min(half, len(rows) - 1)
        waiting += [number, rows[half:], rows[:half]]
    sorted_rows = np.concatenate(order)
    return WallTree(corners[sorted_rows], normals[sorted_rows], np.array(boxes), np.array(links, dtype=np.int32))


def segment_normals(start: np.ndarray, end: np.ndarray, axisymmetric: bool) -> np.ndarray:
    """Return unit normals at both ends of segments (w, 2) [m] with the body on their left, shape (w, 2, 2).

    The next segment begins exactly where one ends; axisymmetric ones go on, mirrored, behind the axis.
    """
    step = end - start
    length = np.linalg.norm(step, axis=1)
    number = np.unique(np.concatenate([start, end]), axis=0, return_inverse=True)[1].reshape(2, -1)
    meeting = np.bincount(number.ravel())
    angles = []  # of the chord with the curve at both of its ends
    for side, corner in enumerate((start, end)):
        neighbour = np.zeros(len(meeting), dtype=np.int64)
        neighbour[number[1 - side]] = np.arange(len(start))
        row = neighbour[number[side]]
        known = meeting[number[side]] == 2
        beside, beyond = step[row], length[row]
        if axisymmetric:
            mirrored = corner[:, 0] == 0.0
            known |= mirrored
            beside = np.where(mirrored[:, None], step * [1.0, -1.0], beside)
            beyond = np.where(mirrored, length, beyond)
        first, second = (beside, step) if side == 0 else (step, beside)
        turn = np.arctan2(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0], np.sum(first * second, axis=1))
        angles.append(np.where(known & (np.abs(turn) <= SMOOTH), turn * length / (length + beyond), 0.0))
    one, other = angles
    angle = np.where(one * other > 0.0, np.sign(one) * np.minimum(np.abs(one), np.abs(other)), 0.0)
    along = step / length[:, None]
    upright = np.cos(angle)[:, None] * along @ [[0.0, -1.0], [1.0, 0.0]]
    swing = np.sin(angle)[:, None] * along
    return np.stack([upright - swing, upright + swing], axis=1)


def triangle_normals(corners: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return unit normals at the corners of triangles, shape (w, 3, 3)."""
    edges = np.roll(corners, -1, axis=1) - corners
    area = np.cross(edges[:, 0], edges[:, 1])
    normal = area / np.maximum(np.linalg.norm(area, axis=1), 1e-300)[:, None]
    back = -np.roll(edges, 1, axis=1)
    angle = np.arctan2(np.linalg.norm(np.cross(edges, back), axis=2), np.sum(edges * back, axis=2)).ravel()
    order = np.argsort(triangles.ravel(), kind="stable")
    first = np.searchsorted(triangles.ravel()[order], np.arange(triangles.max() + 2))
    result = np.empty((triangles.size, 3))
    for begin in range(0, triangles.size, CORNERS):
        some = np.arange(begin, min(begin + CORNERS, triangles.size))
        vertex = triangles.ravel()[some]
        count = first[vertex + 1] - first[vertex]
        mine = np.repeat(np.arange(len(some)), count)
        place = np.arange(len(mine)) - np.repeat(np.cumsum(count) - count, count) + np.repeat(first[vertex], count)
        other = order[place]
        near = np.sum(normal[some[mine] // 3] * normal[other // 3], axis=1) > np.cos(SMOOTH)
        weight = np.where(near, angle[other], 0.0)[:, None] * normal[other // 3]
        result[some] = np.stack([np.bincount(mine, weight[:, k], len(some)) for k in range(3)], axis=1)
    result /= np.maximum(np.linalg.norm(result, axis=1), 1e-300)[:, None]
    return result.reshape(corners.shape)


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
        parts = [np.empty((0, 3))]
        for first in range(0, len(points), POINTS):
            some = points[first : first + POINTS]
            # The search begins with the triangles of the nearest centroids.
            count = min(3, len(self.determinant))
            near = self.middles.query(some, count)[1].reshape(-1)
            columns = _columns(some)
            foot, least = _columns(np.empty_like(some)), np.full(len(some), np.inf)
            self._replace_farther(columns, foot, least, np.repeat(np.arange(len(some)), count), near)
            for rows, pieces in self._nearer_boxes(columns, least):
                self._replace_farther(columns, foot, least, rows, pieces)
            parts.append(np.stack(foot, axis=1))
        return np.concatenate(parts)

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
        result = self._foot(at, pieces)
        distance = np.asarray(sum((one - other) ** 2 for one, other in zip(result, at, strict=True)))
        first = np.flatnonzero(np.diff(rows, prepend=-1))
        nearest = np.repeat(np.minimum.reduceat(distance, first), np.diff(first, append=len(rows)))
        best = np.flatnonzero((distance == nearest) & (distance < least[rows] * (1.0 - 1e-12)))
        best = best[np.diff(rows[best], prepend=-1) > 0]  # feet that are equally near stay
        least[rows[best]] = distance[best]
        for one, other in zip(foot, result, strict=True):
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
