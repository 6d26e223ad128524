"""The surface of a body as segments that bound it, each with the solid on its left.

A profile may touch or cross itself: two parts joined by a bridge of no width, a slit that closes, a figure of eight.
The crossing number (`Body.contains`) decides what is solid. Parts of edges with solid or air on both sides are not
walls and are removed. Intersections of lines with the remaining segments are exact, see crossings.py.
"""

from itertools import pairwise

import numpy as np

# Fractions of the body's size: the distance from an edge at which its two sides are tested, and the distance below
# which a point counts as on an edge. Both are some thousand rounding errors of a coordinate.
BESIDE = 1e-12
ON_EDGE = 1e-13
# Edges that are tested together for others that meet them.
BLOCK = 128  # speed only


def bounding_walls(profile: np.ndarray, contains) -> tuple[np.ndarray, np.ndarray]:
    """Return start and end points [m] of the segments between air and solid, each (w, 2), with the solid on their left.

    Left is counter-clockwise in a plane with the first coordinate to the right and the second upwards.

    Args:
        profile: Points around the body [m], shape (k, 2); the last is joined to the first.
        contains: Function that returns whether points (n, 2) are inside the body.
    """
    start, end = profile, np.roll(profile, -1, axis=0)
    keep = np.any(start != end, axis=1)
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
    found = []
    for row in range(len(start)):
        if not (inner[row].any() or ends_on[row].any()):
            found.append(np.empty((0, 2)))
            continue
        t = np.concatenate([crossing[row][inner[row]], t1[row][ends_on[row]]])
        points = np.concatenate([start[row] + crossing[row][inner[row], None] * along[row], other_start[ends_on[row]]])
        found.append(points[np.argsort(t, kind="stable")])
    return found
