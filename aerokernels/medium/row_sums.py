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
from .cell_shares import CellShares
from .edge_lines import EdgeLines
from .opposite_sides import row_numbers

REACH = 8  # steps from cell to cell over which a deficit may be distributed
LACKING = 1e-6  # deficits below this fraction of the range of the averages are neglected
MOST_CELLS = 30_000  # larger connected regions are left unchanged, to limit the time
# The constants e of bounded.py for a cell's average, the sum along a line of edges, and a row's sum: the greater, the
# more readily the equation is violated.
GIVE_CELL, GIVE_LINE, GIVE_ROW = 1e-2, 3e-4, 1e-10
ALONG = 0.5  # fraction of a row's cells with a deficit above which the row counts as running along the shock
HAT = 1.5  # half width of a hat function, in cells


def keep_row_sums(
    cells: CellShares,
    average: np.ndarray,
    values: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    joined: tuple[np.ndarray, np.ndarray] | None = None,
    lines: EdgeLines | None = None,
) -> np.ndarray:
    """Return values at the vertices, shape (vertex_count,), within their bounds, that keep the sums along rows.

    Args:
        cells: Weights of the vertices in the flow's cells.
        average: Averages over the flow's cells, shape (flow's cells,).
        values: Initial values, within the bounds, shape (vertex_count,).
        low: Least values allowed, shape (vertex_count,).
        high: Greatest values allowed, shape (vertex_count,).
        joined: Which of the flow's cells are adjacent in rows (`joined_across`); None where there are no rows.
        lines: Lines of edges whose sums are to be kept as well, or None.
    """
    from scipy.sparse.csgraph import connected_components

    scale = float(np.ptp(average))
    lacks = cells.lacks(average, values)
    lacking = np.abs(lacks) > LACKING * scale
    if scale == 0.0 or not lacking.any():
        return values
    near = lacking.astype(np.int32)
    for _ in range(REACH):
        near = ((cells.across @ near) > 0).astype(np.int32)
    region = np.flatnonzero(near)
    count, part = connected_components(cells.across[region][:, region], directed=False)
    order = np.argsort(part, kind="stable")
    found = values.copy()
    # A vertex may change if all its cells are in the region; they are then in one connected part of it.
    inside = np.diff(cells.turned.indptr) == np.asarray((cells.turned.astype(bool) @ near.astype(float)), dtype=int)
    for some in np.split(region[order], np.cumsum(np.bincount(part, minlength=count))[:-1]):
        if len(some) > MOST_CELLS:
            continue
        sums = _hats(some, cells) if joined is None else _stretches(some, joined, len(average))
        _place(cells, some, sums, lines, lacking, lacks / scale, found, inside, low, high, scale)
    return found


def _place(cells, some, sums, lines, lacking, lacks, found, inside, low, high, scale: float) -> None:
    """Change the values `found` in one connected part of the region, in place."""
    from scipy.sparse import csr_array, diags_array, vstack

    rows, of, weight = sums
    weight = weight * cells.area[some][of]
    total = np.bincount(rows, weight)
    crossed = np.bincount(rows, weight * lacking[some][of]) <= ALONG * total
    share = cells.share[some]
    vertex = np.unique(share.indices)
    vertex = vertex[inside[vertex]]
    mean = diags_array(1.0 / cells.size[some]) @ share.tocsc()[:, vertex].tocsr()
    number = np.cumsum(crossed) - 1
    kept = crossed[rows]
    over = csr_array(
        (weight[kept] / total[rows[kept]], (number[rows[kept]], of[kept])), shape=(int(crossed.sum()), len(some))
    )
    area = cells.area[some]
    asked, equations = [lacks[some], over @ lacks[some]], [mean, over @ mean]
    if lines is not None:
        edge = np.flatnonzero(np.isin(lines.middle, vertex))
        along = _along_lines(lines, edge, lacking)
        own = lines.mean[edge]
        asked.append(along @ ((lines.wanted[edge] - own @ found) / scale))
        equations.append(along @ own.tocsc()[:, vertex].tocsr())
    gives = [GIVE_CELL * np.median(area) / area, np.full(over.shape[0], GIVE_ROW)]
    gives += [np.full(len(own), GIVE_LINE) for own in asked[2:]]
    give = np.concatenate(gives)
    least = np.minimum((low[vertex] - found[vertex]) / scale, 0.0)
    most = np.maximum((high[vertex] - found[vertex]) / scale, 0.0)
    hard = give == GIVE_ROW
    change = least_change(vstack(equations).tocsr(), give, np.concatenate(asked), least, most, hard)
    found[vertex] = np.clip(found[vertex] + scale * change, low[vertex], high[vertex])


def _along_lines(lines: EdgeLines, edge: np.ndarray, lacking: np.ndarray):
    """Return a matrix of means along contiguous edges, sparse, shape (stretches, edges), none of them along a shock."""
    from scipy.sparse import csr_array

    new = np.ones(len(edge), dtype=bool)
    new[1:] = (np.diff(edge) != 1) | (np.diff(lines.line[edge]) != 0)
    stretch, length = np.cumsum(new) - 1, lines.length[edge]
    total = np.bincount(stretch, length)
    crossed = np.bincount(stretch, length * lacking[lines.cells[edge]].any(axis=1)) <= ALONG * total
    kept = crossed[stretch]
    number = (np.cumsum(crossed) - 1)[stretch[kept]]
    weight = length[kept] / total[stretch[kept]]
    return csr_array((weight, (number, np.flatnonzero(kept))), shape=(int(crossed.sum()), len(edge)))


def _stretches(some: np.ndarray, joined, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the contiguous parts of rows in a set of cells: number of the part, index in the set, and weight."""
    rows = row_numbers(joined, count, some)
    return rows, np.tile(np.arange(len(some)), 2), np.ones(len(rows))


def _hats(some: np.ndarray, cells: CellShares) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the same for cells without rows: each has weights in two hat functions along either axis."""
    step = HAT * float(np.sqrt(np.median(cells.area[some])))
    rows, of, weight, count = [], [], [], 0
    for place in cells.center[some].T:
        at = (place - place.min()) / step
        left = np.floor(at).astype(int)
        for hat, share in ((left, 1.0 - (at - left)), (left + 1, at - left)):
            rows.append(count + hat)
            of.append(np.arange(len(some)))
            weight.append(share)
        count += int(left.max()) + 2
    _, number = np.unique(np.concatenate(rows), return_inverse=True)
    return number, np.concatenate(of), np.concatenate(weight)
