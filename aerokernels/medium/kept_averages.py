r"""Values at vertices whose bilinear interpolant keeps the average over every cell of the flow.

Values that are right at the vertices are not enough: on cells of size h the mean of the interpolant through them misses
a cell's average by h^2 / 12 of the second derivatives, of one sign wherever the flow is curved one way, and integrals
along rays add it up. So every vertex is moved by the mean of what the cells about it lack, under their shares of it,

    v_k <- v_k + sum_c W_ck (a_c - mean_c(v)) / sum_c W_ck,

with W_ck what vertex k stands for in the flow's cell c (of r dr dz, if axisymmetric).

A quadrilateral has about one vertex, and one average to keep: a continuous function has nothing left to follow the
flow with. Cut in four from its middle (a triangle in three, as such cells are anyway) it has four vertices and more,
and the averages are kept by such sweeps, each from ahead of where the one before led (Y. Nesterov, Sov. Math. Dokl. 27
(1983) 372; begun anew where that led back, as B. O'Donoghue and E. Candes do), over all cells, then over the
neighbourhood of those that lack something still, until what is lacking changes no more: it is the least then, in
squares. What is left goes to the vertices that a cell has for itself.

No vertex leaves the averages of the cells that have it, beside a captured shock, or goes beyond those of their
neighbours by more than a quarter of what they differ by, elsewhere. The values to begin with are always allowed, but
for densities below a tenth of those about a vertex. So not every average can be kept: a cell of 1.1 between cells of 1
and 2 would take a value of 0.7 in its middle. What such cells lack goes to their neighbours, so that rows and columns
of cells are kept (row_sums.py); cell by cell `what_is_lacking` tells it.

Cells that stay whole ("bilinear") are swept twice where the flow is smooth: after once what is lacking is of
fourth order.
"""

import numpy as np

from .cell_shares import CellShares, cell_shares
from .edge_lines import edge_lines
from .mesh import QuadMesh
from .opposite_sides import joined_across
from .refined import cut_in_four, has_seam
from .row_sums import keep_row_sums
from .vertex_values import linear_values_and_smooth, of_parents, values_and_smooth, vertex_gradients

PASSES = 2  # over cells that stay whole
SWEEPS, FIRST_SWEEPS = 200, 40  # at most, and over all cells
LOOK = 10  # sweeps after which it is seen whether what is lacking still changes
ENOUGH = 1e-8  # of the range of the averages: by so much what a cell lacks may still change
RINGS = 4  # of cells about those that lack something, over which sweeps go on
BEYOND = 0.25  # of what the averages about a vertex differ by: so far it may leave their range in a smooth flow
NEAR = 1e-8  # of the mesh's size: a wall's place nearer than this to a vertex is there
LEAST_SHARE = 0.1  # of the least average about a vertex, counted from vacuum, below which its value does not fall


def conserving_values(mesh: QuadMesh, average: np.ndarray, vacuum: float = -np.inf) -> np.ndarray:
    """Vertex values, shape (vertex_count,), on cells as they are.

    Args:
        mesh: The mesh.
        average: Averages, shape (cell_count,).
        vacuum: The value of no gas, above which values stay where averages do.
    """
    values, smooth = values_and_smooth(mesh, average)
    if mesh.parents is not None:
        return keep_averages(mesh, values, average, smooth, vacuum)
    weights, vertex = mesh.corner_weights, mesh.cells.ravel()
    share = np.bincount(vertex, weights.ravel(), len(mesh.vertices))
    share = np.where(share > 0.0, share, 1.0)
    for _ in range(PASSES):
        lacks = np.where(smooth, what_is_lacking(mesh, average, values), 0.0)
        values = values + np.bincount(vertex, (weights * lacks[:, None]).ravel(), len(mesh.vertices)) / share
    return np.asarray(values)


def what_is_lacking(mesh: QuadMesh, average: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Average of the flow's cell that each cell is, or is a part of, less the mean of the interpolant over it.

    Args:
        mesh: The mesh.
        average: Averages, shape (cell_count,).
        values: Values at the vertices, shape (vertex_count,).
    """
    weights = mesh.corner_weights
    lacks = average - (weights * values[mesh.cells]).sum(axis=1) / weights.sum(axis=1)
    return lacks if mesh.parents is None else of_parents(mesh, lacks)[mesh.parents]


def cut_and_kept(
    mesh: QuadMesh,
    average: np.ndarray,
    vacuum: float = -np.inf,
    walls: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[QuadMesh, np.ndarray, np.ndarray]:
    """A mesh whose cells are parts of these, values at its vertices that keep the averages, and the average of each.

    Args:
        mesh: The mesh; where its cells are parts already, it is the one that is returned.
        average: Averages, shape (cell_count,).
        vacuum: The value of no gas, above which values stay where averages do.
        walls: Places [m], shape (n, 2), and the values that the interpolant has there.

    Raises:
        ValueError: A mesh that cannot be cut: it has two vertices in one place.
    """
    if has_seam(mesh):
        raise ValueError(
            "interpolation 'conserving' cuts cells, and this mesh closes on itself in a seam, with two vertices in one "
            "place: take 'bilinear', or merge them"
        )
    values, smooth = linear_values_and_smooth(mesh, average)
    if mesh.parents is None:
        gradient = vertex_gradients(mesh, values)
        gradient[mesh.cells[~smooth]] = 0.0
        mesh, values = cut_in_four(mesh, values, gradient)
        average = average[mesh.parents]
        average.setflags(write=False)
    held = None if walls is None else _held(mesh, *walls)
    return mesh, keep_averages(mesh, values, average, smooth, vacuum, held), average


def keep_averages(
    mesh: QuadMesh,
    values: np.ndarray,
    average: np.ndarray,
    smooth: np.ndarray,
    vacuum: float = -np.inf,
    held: tuple[np.ndarray, np.ndarray] | None = None,
) -> np.ndarray:
    """Values near the given ones that keep the averages.

    Args:
        mesh: A mesh of parts of the flow's cells.
        values: Values to begin with, shape (vertex_count,).
        average: Averages, shape (cell_count,).
        smooth: Which of the flow's cells neither hold a captured shock nor touch one that does.
        vacuum: The value of no gas.
        held: Vertices whose values are known, and these.
    """
    own, cells = of_parents(mesh, average), cell_shares(mesh)
    low, high = _bounds(cells.share, cells.turned, own, smooth, values, vacuum)
    if held is not None:
        low[held[0]] = high[held[0]] = held[1]
    found = np.clip(values, low, high)
    enough = ENOUGH * float(np.ptp(own))
    _sweep(cells, np.arange(len(own)), own, found, low, high, enough, FIRST_SWEEPS)
    near = (np.abs(cells.lacks(own, found)) > enough).astype(float)
    if near.any():
        for _ in range(RINGS):
            near = ((cells.share @ (cells.turned @ near)) > 0.0).astype(float)
        _sweep(cells, np.flatnonzero(near), own, found, low, high, enough, SWEEPS)
    alone = np.flatnonzero(cells.alone)
    theirs = cells.share[:, alone]
    room = np.asarray(theirs.sum(axis=1))
    lacks = cells.lacks(own, found) * cells.size / np.where(room > 0.0, room, 1.0)
    cell = cells.turned.indices[cells.turned.indptr[alone]]
    found[alone] = np.clip(found[alone] + lacks[cell], low[alone], high[alone])
    joined = None if mesh.whole is None else joined_across(mesh.whole)
    return keep_row_sums(cells, own, found, low, high, joined, edge_lines(mesh, own))


def _sweep(cells: CellShares, some, own, found, low, high, enough: float, sweeps: int) -> None:
    """Sweep over some of the flow's cells and the vertices that no other cells have, in place.

    Ends when what cells lack has not changed by `enough` in some sweeps: it is next to nothing, or as little as can be.
    """
    share, size, own = cells.share[some], cells.size[some], own[some]
    if len(some) < len(cells.size):
        count = np.bincount(share.indices, minlength=len(found))
        vertex = np.flatnonzero((count > 0) & (count == np.diff(cells.turned.indptr)))
    else:
        vertex = np.arange(len(found))
    inner = share.tocsc()[:, vertex].tocsr()
    turned = inner.T.tocsr()
    values, low, high = found[vertex], low[vertex], high[vertex]
    wanted = own * size - share @ found + inner @ values
    whole = cells.whole[vertex]
    rate = np.where(whole > 0.0, 1.0 / np.where(whole > 0.0, whole, 1.0), 0.0)
    before, ahead, restart = np.full(len(own), np.inf), values, 0
    for sweep in range(sweeps):
        lacks = (wanted - inner @ ahead) / size
        if sweep % LOOK == 0:
            if np.abs(lacks - before).max() <= enough:
                break
            before = lacks
        moved = np.clip(ahead + rate * (turned @ lacks), low, high)
        step = moved - values
        if np.sum((ahead - moved) * whole * step) > 0.0:  # no BLAS, whose threads cost more than they save
            restart = sweep
        ahead = moved + (sweep - restart) / (sweep - restart + 3.0) * step
        values = moved
    found[vertex] = values


def _held(mesh: QuadMesh, points: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The vertices that lie at some places, and the mean of the values there."""
    from scipy.spatial import KDTree

    size = float(np.ptp(mesh.vertices, axis=0).max())
    distance, vertex = KDTree(mesh.vertices).query(points)
    near = distance < NEAR * size
    count = np.bincount(vertex[near], minlength=len(mesh.vertices))
    some = np.flatnonzero(count)
    return some, np.bincount(vertex[near], values[near], len(mesh.vertices))[some] / count[some]


def _bounds(share, turned, own, smooth, values, vacuum: float) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest value allowed at each vertex; those to begin with are, if they are no vacuum."""
    low, high = _extremes(turned, own, own, values)
    wide = _extremes(turned, *_extremes(share, low, high, own), values)
    alone = np.diff(turned.indptr) == 1  # a cell's own average is no range: that of its neighbours is
    low, high = np.where(alone, wide[0], low), np.where(alone, wide[1], high)
    touched = (turned @ (~smooth).astype(float)) > 0.0
    more = BEYOND * (wide[1] - wide[0])
    least, greatest = np.where(touched, low, wide[0] - more), np.where(touched, high, wide[1] + more)
    floor = np.where(low > vacuum, vacuum + LEAST_SHARE * (low - vacuum), -np.inf) if np.isfinite(vacuum) else -np.inf
    return np.maximum(np.minimum(least, values), floor), np.maximum(greatest, values)


def _extremes(rows, low, high, empty) -> tuple[np.ndarray, np.ndarray]:
    """Least of `low` and greatest of `high` of what each row of a sparse matrix lists; `empty` where it lists none."""
    begin, some = rows.indptr[:-1], np.diff(rows.indptr) > 0
    least, greatest = np.array(empty, dtype=float), np.array(empty, dtype=float)
    least[some] = np.minimum.reduceat(low[rows.indices], begin[some])
    greatest[some] = np.maximum.reduceat(high[rows.indices], begin[some])
    return least, greatest
