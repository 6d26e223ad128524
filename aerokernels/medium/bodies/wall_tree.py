"""The surface of a body for kernels: its pieces in a tree of bounding boxes.

Pieces are segments of a profile, or triangles of a surface in space. Nodes are in depth-first order: the first child
follows its parent, and each node has a link to the node where the traversal continues if its box is missed. Kernels
therefore need no stack.
"""

from dataclasses import dataclass

import numpy as np

# Most pieces of a leaf.
LEAF = 4  # speed only
# Margin of the boxes around their pieces, as a fraction of the body's size: some million rounding errors.
MARGIN = 1e-9


@dataclass(frozen=True, eq=False)
class WallTree:
    """Pieces of a surface and their bounding boxes; corners have d coordinates: (r, z), (y, z) or (x, y, z) [m].

    Attributes:
        corners: Corners of each piece, shape (w, d, d): segments with the solid on their left, triangles
            counter-clockwise seen from outside.
        normals: Outward unit normals at the corners, linear between them, shape (w, d, d): see normals.py.
        boxes: Lowest and highest corner of each node's box [m], shape (n, 2, d).
        links: For each node the next node after all its descendants, its first piece and the one after its last, shape
            (n, 3); only leaves have pieces.
    """

    corners: np.ndarray
    normals: np.ndarray
    boxes: np.ndarray
    links: np.ndarray

    @property
    def kernel_rows(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Corners, normals and boxes as kernels take them, in rows of four numbers.

        In the plane a row is a segment, its normals, or a box. In space a row is a corner of a triangle, the normal
        there, or a corner of a box, padded with a zero.
        """
        all_rows = self.corners, self.normals, self.boxes
        if self.corners.shape[-1] == 2:
            return tuple(rows.reshape(-1, 4) for rows in all_rows)  # type: ignore[return-value]
        return tuple(np.pad(rows.reshape(-1, 3), ((0, 0), (0, 1))) for rows in all_rows)  # type: ignore[return-value]

    def children(self, node: int, rows: np.ndarray) -> list[tuple[int, np.ndarray]]:
        """Return the two children of a node that is not a leaf, each with the rows of lines or points to test there."""
        return [(node + 1, rows), (int(self.links[node + 1][0]), rows)]


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
