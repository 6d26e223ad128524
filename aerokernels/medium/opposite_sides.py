"""Rows of quadrilaterals: what a line across opposite sides passes, cell after cell.

In a structured mesh these are its rows and columns; where blocks join otherwise, or cells lie in no order that a file
tells, they are found by the cells' neighbours all the same. A cell lies in two: that through its sides 0 and 2, and
that through its sides 1 and 3.
"""

import numpy as np

from .mesh import QuadMesh


def joined_across(mesh: QuadMesh) -> tuple[np.ndarray, np.ndarray]:
    """Pairs that follow one another in a row, each both ways round; of cell c, c is one way and c + count the other.

    Args:
        mesh: The mesh, of `count` cells.
    """
    count = len(mesh.cells)
    cell, side = np.nonzero(mesh.neighbors >= 0)
    beyond = mesh.neighbors[cell, side]
    # The side by which the neighbour has this cell: two convex cells share no more than one.
    other = np.argmax(mesh.neighbors[beyond] == cell[:, None], axis=1)
    return cell + count * (side % 2), beyond + count * (other % 2)


def row_numbers(joined: tuple[np.ndarray, np.ndarray], count: int, some: np.ndarray | None = None) -> np.ndarray:
    """Number of the row of each cell, first through sides 0 and 2, then through 1 and 3: shape (2 * cells,).

    Args:
        joined: What `joined_across` returns.
        count: Cells of the mesh.
        some: Cells to which the mesh is confined: rows are stretches then that go on without a gap; None for all.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    first, second = joined
    if some is not None:
        place = np.full(count, -1)
        place[some] = np.arange(len(some))
        kept = (place[first % count] >= 0) & (place[second % count] >= 0)
        first, second = (place[at[kept] % count] + len(some) * (at[kept] // count) for at in (first, second))
        count = len(some)
    ones = np.ones(len(first), dtype=np.int8)
    graph = coo_array((ones, (first, second)), shape=(2 * count, 2 * count))
    return np.asarray(connected_components(graph, directed=False)[1])


def ways_across(mesh: QuadMesh) -> np.ndarray:
    """The way across each cell [m], from the middle of side 0 to that of side 2, then from 1 to 3: shape (2 count,)."""
    middle = 0.5 * (mesh.corners + np.roll(mesh.corners, -1, axis=1))
    return np.concatenate([np.linalg.norm(middle[:, k + 2] - middle[:, k], axis=1) for k in (0, 1)])
