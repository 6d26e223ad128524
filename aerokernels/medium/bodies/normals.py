r"""Outward normals of a body's surface, given at the corners of its pieces and linear between them.

The profile of a curved body is a chain of chords, whose own normals jump from one chord to the next. The normal of the
curve through the corners does not: at a corner between chords of lengths L0 and L, which turn by the angle a, the
tangent of the circle through three corners is a L / (L0 + L) off the second chord. A chord of a circle has the same
angle at both ends, and the direction between its two normals at a share of the chord is that of the circle there. Where
the angles at the ends of a chord differ, the smaller one is taken: none beside a straight piece, and where the curve
turns the other way. Corners that turn by more than SMOOTH are edges of the body: there chords keep their own normals.

A triangle has at each corner the mean normal of the triangles there that lean from it by less than SMOOTH, weighted by
their angles at the corner.
"""

import numpy as np

SMOOTH = np.radians(10.0)
CORNERS = 1 << 18  # corners of triangles whose neighbours are in memory together; speed only


def segment_normals(start: np.ndarray, end: np.ndarray, axisymmetric: bool) -> np.ndarray:
    """Return unit normals at both ends of segments, with the body on their left, shape (w, 2, 2).

    Args:
        start: First points [m], shape (w, 2): (y, z) or (r, z).
        end: Second points [m], shape (w, 2). The next segment begins exactly where one ends.
        axisymmetric: Whether the segments go on, mirrored, behind the axis.
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
    """Return unit normals at the corners of triangles, shape (w, 3, 3).

    Args:
        corners: Their corners [m], counter-clockwise seen from outside, shape (w, 3, 3).
        triangles: Numbers of their corners, shape (w, 3).
    """
    edges = np.roll(corners, -1, axis=1) - corners
    area = np.cross(edges[:, 0], edges[:, 1])
    normal = area / np.maximum(np.linalg.norm(area, axis=1), 1e-300)[:, None]
    back = -np.roll(edges, 1, axis=1)
    angle = np.arctan2(np.linalg.norm(np.cross(edges, back), axis=2), np.sum(edges * back, axis=2)).ravel()
    order = np.argsort(triangles.ravel(), kind="stable")
    first = np.searchsorted(triangles.ravel()[order], np.arange(triangles.max() + 2))
    found = np.empty((triangles.size, 3))
    for begin in range(0, triangles.size, CORNERS):
        some = np.arange(begin, min(begin + CORNERS, triangles.size))
        vertex = triangles.ravel()[some]
        count = first[vertex + 1] - first[vertex]
        mine = np.repeat(np.arange(len(some)), count)
        place = np.arange(len(mine)) - np.repeat(np.cumsum(count) - count, count) + np.repeat(first[vertex], count)
        other = order[place]
        near = np.sum(normal[some[mine] // 3] * normal[other // 3], axis=1) > np.cos(SMOOTH)
        weight = np.where(near, angle[other], 0.0)[:, None] * normal[other // 3]
        found[some] = np.stack([np.bincount(mine, weight[:, k], len(some)) for k in range(3)], axis=1)
    found /= np.maximum(np.linalg.norm(found, axis=1), 1e-300)[:, None]
    return found.reshape(corners.shape)
