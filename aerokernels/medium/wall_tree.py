"""The surface of a body for kernels: its segments under a tree of boxes that a line goes through from node to node.

Nodes are in the order in which a line meets them that goes down into every box: the first child follows its parent,
and each node knows where to go on if its box is missed. Kernels need no stack for that.
"""

from dataclasses import dataclass

import numpy as np

# Segments of a leaf at most.
LEAF = 4
# By how much boxes are larger than what they hold, as a share of the body's size: some million roundings.
ROOM = 1e-9


@dataclass(frozen=True, eq=False)
class WallTree:
    """Segments of a surface and boxes about them.

    Attributes:
        segments: r1, z1, r2, z2 of each segment [m] (planar: y for r), solid on its left, shape (w, 4).
        boxes: Lowest r and z, greatest r and z of each node [m], shape (n, 4).
        links: For each node the one after all its children, the first of its segments and the one after the last,
            shape (n, 3); only leaves have segments.
    """

    segments: np.ndarray
    boxes: np.ndarray
    links: np.ndarray


def wall_tree(start: np.ndarray, end: np.ndarray) -> WallTree:
    """The tree of segments from `start` to `end` [m], each (w, 2)."""
    low, high = np.minimum(start, end), np.maximum(start, end)
    middle = 0.5 * (low + high)
    room = ROOM * float((high.max(axis=0) - low.min(axis=0)).max())
    boxes: list[np.ndarray] = []
    links: list[list[int]] = []
    order: list[np.ndarray] = []
    placed = 0
    # What is still to be put down, the last one first: rows, or the number of a node whose children are all there.
    waiting: list[np.ndarray | int] = [np.arange(len(start))]
    while waiting:
        rows = waiting.pop()
        if isinstance(rows, int):
            links[rows][0] = len(links)
            continue
        number = len(links)
        boxes.append(np.concatenate([low[rows].min(axis=0) - room, high[rows].max(axis=0) + room]))
        if len(rows) <= LEAF:
            links.append([number + 1, placed, placed + len(rows)])
            order.append(rows)
            placed += len(rows)
            continue
        links.append([0, 0, 0])
        axis = int(np.argmax(np.ptp(middle[rows], axis=0)))
        rows = rows[np.argsort(middle[rows, axis], kind="stable")]
        # Whole leaves on the first side.
        half = LEAF * max(1, round(len(rows) / (2 * LEAF)))
        half = min(half, len(rows) - 1)
        waiting += [number, rows[half:], rows[:half]]
    sorted_rows = np.concatenate(order)
    segments = np.concatenate([start[sorted_rows], end[sorted_rows]], axis=1)
    return WallTree(segments, np.array(boxes), np.array(links, dtype=np.int32))
