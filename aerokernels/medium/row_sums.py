r"""What a cell beside a shock cannot keep goes to its neighbours, so that lines across them meet what the file holds.

A bounded continuous interpolant cannot keep every cell's average beside a captured shock. As in flux-corrected
transport (J. P. Boris, D. L. Book, J. Comput. Phys. 11 (1973) 38) what is cut off in one cell is given to those with
room: about each cell that lacks something the cells within REACH steps from cell to cell may lack or exceed theirs too,
as little as possible (in squares), such that

    sum_c A_c (a_c - mean_c(v)) = 0        along every row and every column of cells there,

A_c the areas, which a line in the plane meets, and with them over every box whose sides these rows and columns cross
whole. Rows of quadrilaterals are those of opposite_sides.py, in a mesh of any blocks. Cells without rows (triangles,
polygons) are summed under hats in y and in z, as wide as cells. How a row's sum is shared among the lines in it is left
open by that: in structured meshes sums along lines of edges (edge_lines.py) are asked for as well, and give way. No
value leaves the bounds it had. A row that runs along the shock, in which more than half of the cells lack something,
has no room to take from and is not asked for anything. What bounds forbid stays lacking, and `MeshSamples.lacking`
tells it.
"""

import numpy as np

from .bounded import least_change
from .cell_shares import CellShares
from .edge_lines import EdgeLines
from .opposite_sides import row_numbers

REACH = 8  # steps from cell to cell that what a cell lacks may go
LACKING = 1e-6  # of the range of the averages: cells that lack less are kept
MOST_CELLS = 30_000  # that hang together: more of them are left as they are, for time's sake
# How readily a cell's average, the sum along a line of edges and a row's sum give way (see bounded.py).
GIVE_CELL, GIVE_LINE, GIVE_ROW = 1e-2, 3e-4, 1e-10
ALONG = 0.5  # share of cells that lack something above which a row runs along the shock
HAT = 1.5  # width of half a hat, in cells


def keep_row_sums(
    cells: CellShares,
    average: np.ndarray,
    values: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    joined: tuple[np.ndarray, np.ndarray] | None = None,
    lines: EdgeLines | None = None,
) -> np.ndarray:
    """Values at the vertices, shape (vertex_count,), within their bounds, that keep sums across what cells lack.

    Args:
        cells: Shares of the vertices in the flow's cells.
        average: Averages over these, shape (flow's cells,).
        values: Values to begin with, within the bounds, shape (vertex_count,).
        low: Least values, shape (vertex_count,).
        high: Greatest values.
        joined: Which of the flow's cells follow one another in rows (`joined_across`); None where there are no rows.
        lines: Lines of edges whose sums are kept too, or None.
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
    # A vertex is moved where all of its cells are of the region, and so of one part of it.
    inside = np.diff(cells.turned.indptr) == np.asarray((cells.turned.astype(bool) @ near.astype(float)), dtype=int)
    for some in np.split(region[order], np.cumsum(np.bincount(part, minlength=count))[:-1]):
        if len(some) > MOST_CELLS:
            continue
        sums = _hats(some, cells) if joined is None else _stretches(some, joined, len(average))
        _place(cells, some, sums, lines, lacking, lacks / scale, found, inside, low, high, scale)
    return found


def _place(cells, some, sums, lines, lacking, lacks, found, inside, low, high, scale: float) -> None:
    """Change the values in one part of the region, in place."""
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
    """Means along stretches of lines over some edges, sparse, shape (stretches, edges), but for those along a shock."""
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
    """Stretches of rows in a set of cells: number of the stretch, place in the set, and weight."""
    rows = row_numbers(joined, count, some)
    return rows, np.tile(np.arange(len(some)), 2), np.ones(len(rows))


def _hats(some: np.ndarray, cells: CellShares) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same for cells in no order: each counts in two hats along either axis."""
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
