r"""Values at the vertices of cut cells whose bilinear interpolant keeps the average over every cell of the flow.

A quadrilateral has about one vertex, and one average to keep: a continuous function has nothing left to follow the flow
with. Cut in four from its middle (a triangle in three, as such cells are anyway) it has four vertices and more, and the
averages are kept by sweeps over all of them,

    v_k <- v_k + w sum_c W_ck (a_c - mean_c(v)) / sum_c W_ck,

with W_ck what vertex k stands for in the flow's cell c (of r dr dz, if axisymmetric) and w = 1.5, until next to nothing
is lacking or no more is gained. What is left then goes to the vertices that a cell has for itself.

No vertex leaves the averages of the cells that have it, beside a captured shock, or goes beyond those of their
neighbours by more than a quarter of what they differ by, elsewhere. The values to begin with are always allowed, but
for densities below a tenth of those about a vertex. So not every average can be kept: a cell of 1.1 between cells of 1
and 2 would take a value of 0.7 in its middle. Such cells are left what they lack, which `what_is_lacking` tells.
"""

import numpy as np

from .mesh import QuadMesh
from .refined import cut_in_four
from .vertex_values import linear_values_and_smooth, of_parents, vertex_gradients

SWEEPS = 200  # at most
LOOK, SLOW = 10, 0.995  # sweeps after which it is seen whether what is lacking has become less than this share
RELAXED = 1.5  # times what is lacking is given at once: below 2 sweeps converge
ENOUGH = 1e-9  # of the range of the averages: what a cell may lack on an average
BEYOND = 0.25  # of what the averages about a vertex differ by: so far it may leave their range in a smooth flow
NEAR = 1e-8  # of the mesh's size: a wall's place nearer than this to a vertex is there
LEAST_SHARE = 0.1  # of the least average about a vertex, counted from vacuum, below which its value does not fall


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
    from scipy.sparse import csr_array

    assert mesh.parents is not None
    own = of_parents(mesh, average)
    rows, columns = np.repeat(mesh.parents, 4), mesh.cells.ravel()
    share = csr_array((mesh.corner_weights.ravel(), (rows, columns)), shape=(len(own), len(mesh.vertices)))
    share.sum_duplicates()
    turned = share.T.tocsr()
    size, whole = np.asarray(share.sum(axis=1)), np.asarray(share.sum(axis=0))
    low, high = _bounds(share, turned, own, smooth, values, vacuum)
    if held is not None:
        low[held[0]] = high[held[0]] = held[1]
    enough = ENOUGH * np.ptp(own)
    found = np.clip(values, low, high)
    rate = np.where(whole > 0.0, RELAXED / np.where(whole > 0.0, whole, 1.0), 0.0)
    before = np.inf
    for sweep in range(SWEEPS):
        lacks = own - (share @ found) / size
        if sweep % LOOK == 0:
            left = float(np.abs(lacks).sum())
            if left <= enough * len(lacks) or left > SLOW * before:
                break
            before = left
        found += rate * (turned @ lacks)
        np.clip(found, low, high, out=found)
    alone = np.flatnonzero(np.diff(turned.indptr) == 1)
    theirs = share[:, alone]
    room = np.asarray(theirs.sum(axis=1))
    lacks = (own - (share @ found) / size) * size / np.where(room > 0.0, room, 1.0)
    cell = turned.indices[turned.indptr[alone]]
    found[alone] = np.clip(found[alone] + lacks[cell], low[alone], high[alone])
    return found


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
