r"""Target means of the interpolant along edges of structured cells, for lines of edges that cross a captured shock.

The mean over an edge between two cells is computed from the averages of the cells around it, to fourth order where the
flow is smooth. Across a straight shock through equal cells the sum of these means along a whole line of edges is exact,
wherever in its cell the shock is. The sum of averages along a row of cells does not determine how the sum is
distributed among lines within the row; the sums along lines of edges do.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..mesh import QuadMesh
from ..refined import edges_of_four
from .vertex_values import edge_means


@dataclass(frozen=True, eq=False)
class EdgeLines:
    """Edges between two cells of a structured mesh that was cut in four, in order along each line of edges.

    Attributes:
        mean: Matrix that gives the means over the edges from values at the vertices, sparse, shape (n, vertices).
        middle: The vertex in the middle of each edge, shape (n,).
        cells: The cells on either side of each edge, shape (n, 2).
        target: Target mean over each edge, shape (n,).
        length: Length of each edge [m], shape (n,).
        line: Number of the line of edges to which each edge belongs, shape (n,).
    """

    mean: Any
    middle: np.ndarray
    cells: np.ndarray
    target: np.ndarray
    length: np.ndarray
    line: np.ndarray


def edge_lines(finer: QuadMesh, average: np.ndarray) -> EdgeLines | None:
    """Return the edges between cells, or None for a mesh without rows and columns of at least two cells each.

    Args:
        finer: The mesh, of cells cut in four.
        average: Averages over the flow's cells, shape (flow's cells,).
    """
    from scipy.sparse import csr_array

    whole = finer.whole
    if whole is None or whole.shape is None or min(whole.shape) < 3:
        return None
    ni, nj = whole.shape
    target = edge_means(whole, average)
    a, b = edges_of_four(whole)
    found = []
    for axis, step in ((0, 1), (1, nj)):  # lines of one row of vertices, and of one column
        edge = np.flatnonzero(b - a == step)
        i, j = a[edge] // nj, a[edge] % nj
        line, along, first = (i, j, (i - 1) * (nj - 1) + j) if axis == 0 else (j, i, i * (nj - 1) + j - 1)
        inner = (line > 0) & (line < (ni, nj)[axis] - 1)
        order = np.flatnonzero(inner)[np.lexsort((along[inner], line[inner]))]
        cells = np.stack([first, first + (nj - 1, 1)[axis]], axis=1)
        found.append((edge[order], cells[order], target[axis][i[order], j[order]], line[order] + axis * ni))
    edge, cells, mean, line = (np.concatenate(parts) for parts in zip(*found, strict=True))
    middle = len(whole.vertices) + edge
    ends = np.stack([a[edge], middle, b[edge]], axis=1)
    rows, weight = np.repeat(np.arange(len(edge)), 3), np.tile([0.25, 0.5, 0.25], len(edge))
    matrix = csr_array((weight, (rows, ends.ravel())), shape=(len(edge), len(finer.vertices)))
    length = np.linalg.norm(whole.vertices[b[edge]] - whole.vertices[a[edge]], axis=1)
    return EdgeLines(matrix, middle, cells, mean, length, line)
