"""Recover the rows and columns of a structured quadrilateral mesh that was written as unstructured.

Where a mesh is a logical rectangle, averages become vertex values by a scheme of higher order, and captured shocks keep
their place better (see medium/averages/vertex_values.py). The search starts at a corner, follows the first row of
cells, and steps from each row to the next.
"""

import numpy as np

from aerokernels.medium.mesh_cells import cells_across


def logical_rectangle(cells: np.ndarray, vertex_count: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Return vertices, shape (ni, nj), and cells, shape (ni - 1, nj - 1), of a structured mesh, or None.

    Args:
        cells: Vertices around each cell, all in the same orientation, shape (cell_count, 4).
        vertex_count: Number of vertices.
    """
    count = len(cells)
    degree = np.bincount(cells.ravel(), minlength=vertex_count)
    alone = np.flatnonzero(degree == 1)
    if degree.max() > 4 or len(alone) != 4:
        return None  # a logical rectangle has four corners
    behind = cells_across(cells, vertex_count)
    holder, place = np.argwhere(cells == alone[0])[0]
    row, turn = [int(holder)], [int(place)]
    while len(row) <= count:
        # Cross the edge from corner 1 to corner 2; its ends become corners 0 and 3 of the next cell.
        following = int(behind[row[-1], (turn[-1] + 1) % 4])
        if following < 0:
            break
        shared = cells[row[-1], (turn[-1] + 1) % 4]
        row.append(following)
        turn.append(int(np.argmax(cells[following] == shared)))
    columns = len(row)
    if count % columns:
        return None
    cell, start = np.array(row), np.array(turn)
    rows, vertices = [cell], [_corner(cells, cell, start, 0), _corner(cells, cell, start, 3)]
    last = [int(_corner(cells, cell, start, 1)[-1]), int(_corner(cells, cell, start, 2)[-1])]
    for _ in range(count // columns - 1):
        shared = _corner(cells, cell, start, 3)
        cell = behind[cell, (start + 2) % 4]
        if (cell < 0).any():
            return None
        start = np.argmax(cells[cell] == shared[:, None], axis=1)
        if (_corner(cells, cell, start, 0) != shared).any():
            return None
        rows.append(cell)
        vertices.append(_corner(cells, cell, start, 3))
        last.append(int(_corner(cells, cell, start, 2)[-1]))
    order = np.stack(rows)
    grid = np.concatenate([np.stack(vertices), np.array(last)[:, None]], axis=1)
    expected = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=-1)
    whole = len(np.unique(order)) == count and grid.size == len(np.unique(grid)) == int((degree > 0).sum())
    if not whole or (np.sort(expected, axis=-1) != np.sort(cells[order], axis=-1)).any():
        return None
    return grid, order


def _corner(cells: np.ndarray, cell: np.ndarray, start: np.ndarray, k: int) -> np.ndarray:
    return np.asarray(cells[cell, (start + k) % 4])
