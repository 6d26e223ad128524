"""Rows of quadrilaterals: sequences of cells, each joined to the next across opposite sides.

In a structured mesh these are its rows and columns. They are found from the cells' neighbours, so they also exist in
meshes of several blocks and in files that list cells in any order. Each cell belongs to two rows: one through its sides
0 and 2, and one through its sides 1 and 3.
"""

import numpy as np

from ..mesh import QuadMesh


def joined_across(mesh: QuadMesh) -> tuple[np.ndarray, np.ndarray]:
    """Return all pairs of nodes that are adjacent in a row, each pair in both orders.

    Cell c is two nodes, one for each of its rows: c for that through sides 0 and 2, c + count for the other.

    Args:
        mesh: The mesh, of `count` cells.
    """
    count = len(mesh.cells)
    cell, side = np.nonzero(mesh.neighbors >= 0)
    beyond = mesh.neighbors[cell, side]
    # The neighbour's side at which this cell is: two convex cells share at most one side.
    other = np.argmax(mesh.neighbors[beyond] == cell[:, None], axis=1)
    return cell + count * (side % 2), beyond + count * (other % 2)


def row_numbers(joined: tuple[np.ndarray, np.ndarray], count: int) -> np.ndarray:
    """Return the number of each cell's row, first through sides 0 and 2, then through 1 and 3: shape (2 * cells,).

    Args:
        joined: The result of `joined_across`.
        count: Number of cells of the mesh.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    first, second = joined
    ones = np.ones(len(first), dtype=np.int8)
    graph = coo_array((ones, (first, second)), shape=(2 * count, 2 * count))
    return np.asarray(connected_components(graph, directed=False)[1])


def widths_across(mesh: QuadMesh) -> np.ndarray:
    """Return distances across each cell [m], between midpoints of sides 0 and 2, then of 1 and 3: shape (2 count,)."""
    middle = 0.5 * (mesh.corners + np.roll(mesh.corners, -1, axis=1))
    return np.concatenate([np.linalg.norm(middle[:, k + 2] - middle[:, k], axis=1) for k in (0, 1)])
