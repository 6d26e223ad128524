r"""Transfer the deficits of cells beside a shock to their neighbours, so that sums along rows of cells are kept.

A bounded continuous interpolant cannot keep every cell's average beside a captured shock. As in flux-corrected
transport (J. P. Boris, D. L. Book, J. Comput. Phys. 11 (1973) 38) the deficit of one cell is given to cells whose
bounds leave room. The cells within REACH steps from a cell with a deficit may deviate from their averages, by the
smallest sum of squares for which

    sum_c A_c (a_c - mean_c(v)) = 0        along every row and every column of these cells,

with the areas A_c in the plane, the measure of lines through it. The sum over any box made of whole rows or columns is
then kept, too. Rows of quadrilaterals are those of opposite_sides.py, in meshes of any blocks. For cells without rows
(triangles, polygons) the sums are weighted with hat functions of y and of z that are as wide as cells. A row's sum does
not determine the distribution among the lines in the row: in structured meshes sums along lines of edges
(edge_lines.py) are requested as well, but may be violated. No value leaves its bounds. A row along the shock, in which
more than half of the cells have a deficit, has no cells to balance it, so its sum is not constrained. A deficit that
the bounds forbid to remove remains and is reported by `MeshSamples.lacking`.
"""

import numpy as np

from .bounded import least_change
from .edge_lines import EdgeLines
from .opposite_sides import row_numbers
from .vertex_weights import VertexWeights

REACH = 8  # steps from cell to cell over which a deficit may be distributed
NEGLIGIBLE = 1e-6  # deficits below this fraction of the range of the averages are neglected
MOST_CELLS = 30_000  # larger connected regions are left unchanged, to limit the time
# The constants e of bounded.py for a cell's average, the sum along a line of edges, and a row's sum: the greater, the
# more readily the equation is violated.
CELL_COMPLIANCE, LINE_COMPLIANCE, ROW_COMPLIANCE = 1e-2, 3e-4, 1e-10
ALONG = 0.5  # fraction of a row's cells with a deficit above which the row counts as running along the shock
HAT = 1.5  # half width of a hat function, in cells


def keep_row_sums(
    weights: VertexWeights,
    average: np.ndarray,
    values: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    joined: tuple[np.ndarray, np.ndarray] | None = None,
    lines: EdgeLines | None = None,
) -> np.ndarray:
    """Return values at the vertices, shape (vertex_count,), within their bounds, that keep the sums along rows.

    Args:
        weights: Weights of the vertices in the flow's cells.
        average: Averages over the flow's cells, shape (flow's cells,).
        values: Initial values, within the bounds, shape (vertex_count,).
        low: Least values allowed, shape (vertex_count,).
        high: Greatest values allowed, shape (vertex_count,).
        joined: Which of the flow's cells are adjacent in rows (`joined_across`); None where there are no rows.
        lines: Lines of edges whose sums are to be kept as well, or None.
    """
    from scipy.sparse.csgraph import connected_components

    scale = float(np.ptp(average))
    deficit = weights.deficit(average, values)
    short = np.abs(deficit) > NEGLIGIBLE * scale
    if scale == 0.0 or not short.any():
        return values
    near = short.astype(np.int32)
    for _ in range(REACH):
        near = ((weights.adjacent @ near) > 0).astype(np.int32)
    region = np.flatnonzero(near)
    count, part = connected_components(weights.adjacent[region][:, region], directed=False)
    order = np.argsort(part, kind="stable")
    found = values.copy()
    # A vertex may change if all its cells are in the region; they are then in one connected part of it.
    cells_in_region = np.asarray(weights.transposed.astype(bool) @ near.astype(float), dtype=int)
    inside = np.diff(weights.transposed.indptr) == cells_in_region
    for cells in np.split(region[order], np.cumsum(np.bincount(part, minlength=count))[:-1]):
        if len(cells) <= MOST_CELLS:
            sums = _hats(cells, weights) if joined is None else _row_parts(cells, joined, len(average))
            _balance(weights, cells, sums, lines, short, deficit / scale, found, inside, low, high, scale)
    return found


def _balance(weights, cells, sums, lines, short, deficit, found, inside, low, high, scale: float) -> None:
    """Change the values `found` in one connected part of the region, in place."""
    from scipy.sparse import csr_array, diags_array, vstack

    row, column, entry = sums
    area = weights.area[cells]
    entry = entry * area[column]
    total = np.bincount(row, entry)
    constrained = np.bincount(row, entry * short[cells][column]) <= ALONG * total
    matrix = weights.matrix[cells]
    vertex = np.unique(matrix.indices)
    vertex = vertex[inside[vertex]]
    mean = diags_array(1.0 / weights.cell_total[cells]) @ matrix.tocsc()[:, vertex].tocsr()
    number = np.cumsum(constrained) - 1
    kept = constrained[row]
    row_mean = csr_array(
        (entry[kept] / total[row[kept]], (number[row[kept]], column[kept])), shape=(int(constrained.sum()), len(cells))
    )
    equations, targets = [mean, row_mean @ mean], [deficit[cells], row_mean @ deficit[cells]]
    compliances = [CELL_COMPLIANCE * np.median(area) / area, np.full(row_mean.shape[0], ROW_COMPLIANCE)]
    if lines is not None:
        edge = np.flatnonzero(np.isin(lines.middle, vertex))
        line_mean = _line_means(lines, edge, short)
        edge_mean = lines.mean[edge]
        equations.append(line_mean @ edge_mean.tocsc()[:, vertex].tocsr())
        targets.append(line_mean @ ((lines.target[edge] - edge_mean @ found) / scale))
        compliances.append(np.full(line_mean.shape[0], LINE_COMPLIANCE))
    compliance = np.concatenate(compliances)
    least = np.minimum((low[vertex] - found[vertex]) / scale, 0.0)
    most = np.maximum((high[vertex] - found[vertex]) / scale, 0.0)
    hard = compliance == ROW_COMPLIANCE
    change = least_change(vstack(equations).tocsr(), compliance, np.concatenate(targets), least, most, hard)
    found[vertex] = np.clip(found[vertex] + scale * change, low[vertex], high[vertex])


def _line_means(lines: EdgeLines, edge: np.ndarray, short: np.ndarray):
    """Return a matrix of means along contiguous edges, sparse, shape (stretches, edges), none of them along a shock."""
    from scipy.sparse import csr_array

    new = np.ones(len(edge), dtype=bool)
    new[1:] = (np.diff(edge) != 1) | (np.diff(lines.line[edge]) != 0)
    stretch, length = np.cumsum(new) - 1, lines.length[edge]
    total = np.bincount(stretch, length)
    constrained = np.bincount(stretch, length * short[lines.cells[edge]].any(axis=1)) <= ALONG * total
    kept = constrained[stretch]
    number = (np.cumsum(constrained) - 1)[stretch[kept]]
    weight = length[kept] / total[stretch[kept]]
    return csr_array((weight, (number, np.flatnonzero(kept))), shape=(int(constrained.sum()), len(edge)))


def _row_parts(cells: np.ndarray, joined, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the contiguous parts of rows in a set of cells: number of the part, index in the set, and weight."""
    rows = row_numbers(joined, count, cells)
    return rows, np.tile(np.arange(len(cells)), 2), np.ones(len(rows))


def _hats(cells: np.ndarray, weights: VertexWeights) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the same for cells without rows: each has weights in two hat functions along either axis."""
    step = HAT * float(np.sqrt(np.median(weights.area[cells])))
    hats, entries, count = [], [], 0
    for coordinate in weights.center[cells].T:
        position = (coordinate - coordinate.min()) / step
        left = np.floor(position).astype(int)
        hats += [count + left, count + left + 1]
        entries += [1.0 - (position - left), position - left]
        count += int(left.max()) + 2
    _, number = np.unique(np.concatenate(hats), return_inverse=True)
    return number, np.tile(np.arange(len(cells)), 4), np.concatenate(entries)
