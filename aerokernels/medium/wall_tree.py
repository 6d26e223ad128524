"""The surface of a body for kernels: its pieces under a tree of boxes that a line goes through from node to node.

Pieces are segments of a profile, or triangles of a surface in space.

Nodes are in the order in which a line meets them that goes down into every box: the first child follows its parent,
and each node knows where to go on if its box is missed. Kernels need no stack for that.
"""

from dataclasses import dataclass

import numpy as np

# Pieces of a leaf at most.
LEAF = 4  # speed only
# By how much boxes are larger than what they hold, as a share of the body's size: some million roundings.
MARGIN = 1e-9


@dataclass(frozen=True, eq=False)
class WallTree:
    """Pieces of a surface and boxes about them, d coordinates a corner: (r, z), (y, z) or (x, y, z) [m].

    Attributes:
        corners: Of each piece, shape (w, d, d): segments with the solid on their left, triangles with it behind them,
            looked at counter-clockwise from outside.
        boxes: Lowest and greatest coordinates of each node [m], shape (n, 2, d).
        links: For each node the one after all its children, the first of its pieces and the one after the last,
            shape (n, 3); only leaves have pieces.
    """

    corners: np.ndarray
    boxes: np.ndarray
    links: np.ndarray

    @property
    def kernel_rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners and boxes as kernels take them, rows of four numbers.

        In the plane a row is a segment, or a box. In space a row is a corner, three to a triangle, or one of the two
        corners of a box; its fourth number is none.
        """
        if self.corners.shape[-1] == 2:
            return self.corners.reshape(-1, 4), self.boxes.reshape(-1, 4)
        return tuple(np.pad(rows.reshape(-1, 3), ((0, 0), (0, 1))) for rows in (self.corners, self.boxes))  # type: ignore[return-value]


def wall_tree(corners: np.ndarray) -> WallTree:
    """The tree of pieces with corners [m], shape (w, d, d)."""
    low, high = corners.min(axis=1), corners.max(axis=1)
    middle = 0.5 * (low + high)
    margin = MARGIN * float((high.max(axis=0) - low.min(axis=0)).max())
    boxes: list[np.ndarray] = []
    links: list[list[int]] = []
    order: list[np.ndarray] = []
    placed = 0
    # What is still to be put down, the last one first: rows, or the number of a node whose children are all there.
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
        # Whole leaves on the first side.
        half = LEAF * max(1, round(len(rows) / (2 * LEAF)))
        half = min(half, len(rows) - 1)
        waiting += [number, rows[half:], rows[:half]]
    sorted_rows = np.concatenate(order)
    return WallTree(corners[sorted_rows], np.array(boxes), np.array(links, dtype=np.int32))
