"""Vertex values whose bilinear interpolant has the given average over every cell of the flow, where bounds permit.

Sweeps move every vertex by the mean of the deficits of its cells, weighted by its share W in their integrals, v_k <-
v_k + sum_c W_ck (a_c - mean_c(v)) / sum_c W_ck, accelerated by Nesterov's extrapolation with restarts. Cells cut in
four, triangles and polygons have enough vertices to keep every average but beside a captured shock, where no value
leaves the range around it (docs/theory/cells.md). Cells that are not cut are swept twice where the flow is smooth.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from aerokernels.derived import Derived, cached_on
from aerokernels.medium.averages.vertex_values import (
    linear_values_and_smooth,
    of_parents,
    values_and_smooth,
    vertex_gradients,
)
from aerokernels.medium.mesh import QuadMesh
from aerokernels.medium.refined import cut_in_four, has_seam

CHECK_INTERVAL = 10  # sweeps between two checks whether the deficits still change


def conserving_values(mesh: QuadMesh, average: np.ndarray, vacuum: float = -np.inf) -> np.ndarray:
    """Return vertex values from averages over cells not cut in four; above `vacuum` where these are."""
    values, smooth = values_and_smooth(mesh, average)
    if mesh.parents is not None:
        return _keep_averages(mesh, values, average, smooth, vacuum)
    weights, vertex = mesh.corner_weights, mesh.cells.ravel()
    share = np.bincount(vertex, weights.ravel(), len(mesh.vertices))
    share = np.where(share > 0.0, share, 1.0)
    for _ in range(2):
        deficit = np.where(smooth, cell_deficits(mesh, average, values), 0.0)
        values = values + np.bincount(vertex, (weights * deficit[:, None]).ravel(), len(mesh.vertices)) / share
    return np.asarray(values)


def cell_deficits(mesh: QuadMesh, average: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return each cell's deficit: the average over the flow's cell that it is in minus the interpolant's mean."""
    weights = mesh.corner_weights
    deficit = average - (weights * values[mesh.cells]).sum(axis=1) / weights.sum(axis=1)
    return deficit if mesh.parents is None else of_parents(mesh, deficit)[mesh.parents]


def cut_and_kept(
    mesh: QuadMesh,
    average: np.ndarray,
    vacuum: float = -np.inf,
    walls: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[QuadMesh, np.ndarray, np.ndarray]:
    """Return the mesh cut in four, values at its vertices that keep the averages, and the average for each part.

    A mesh whose cells are parts already is not cut. `walls` has positions [m], shape (n, 2), and the values there.
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
    fixed = None if walls is None else _vertices_at(mesh, *walls)
    return mesh, _keep_averages(mesh, values, average, smooth, vacuum, fixed), average


def _keep_averages(mesh: QuadMesh, values, average, smooth, vacuum: float, fixed=None) -> np.ndarray:
    """Return values near initial ones that keep the averages; `fixed` are vertices whose values are fixed, and these.

    The mesh's cells are parts of the flow's cells, of which `smooth` tells those apart from captured shocks.
    """
    target, weights = of_parents(mesh, average), _vertex_weights(mesh)
    low, high = _bounds(weights.matrix, weights.transposed, target, smooth, values, vacuum)
    if fixed is not None:
        low[fixed[0]] = high[fixed[0]] = fixed[1]
    values = np.clip(values, low, high)
    settled = 1e-8 * float(np.ptp(target))  # a smaller change of the deficits ends the sweeps
    _sweep(weights, np.arange(len(target)), target, values, low, high, settled, 40)
    near = (np.abs(weights.deficit(target, values)) > settled).astype(float)
    if near.any():
        for _ in range(4):  # rings of cells around those with a deficit
            near = ((weights.matrix @ (weights.transposed @ near)) > 0.0).astype(float)
        _sweep(weights, np.flatnonzero(near), target, values, low, high, settled, 200)
    single = np.flatnonzero(np.diff(weights.transposed.indptr) == 1)  # vertices of one cell alone
    inner = weights.matrix[:, single]
    room = np.asarray(inner.sum(axis=1))
    deficit = weights.deficit(target, values) * weights.cell_total / np.where(room > 0.0, room, 1.0)
    cell = weights.transposed.indices[weights.transposed.indptr[single]]
    values[single] = np.clip(values[single] + deficit[cell], low[single], high[single])
    return np.asarray(values)


@dataclass(frozen=True, eq=False)
class _VertexWeights(Derived):
    """Weights of vertices in integrals of a bilinear interpolant over the flow's cells [m2, or m3 per radian].

    `matrix` has shape (flow's cells, vertices); it and its transpose are sparse by rows.
    """

    matrix: Any
    transposed: Any

    @cached_property
    def cell_total(self) -> np.ndarray:
        """Sum of the weights of each of the flow's cells."""
        return np.asarray(self.matrix.sum(axis=1))

    def deficit(self, average: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return the averages minus the means of the interpolant of `values`, shape (flow's cells,)."""
        return np.asarray(average - (self.matrix @ values) / self.cell_total)


@cached_on("mesh")
def _vertex_weights(mesh: QuadMesh) -> _VertexWeights:
    """Return the weights of a mesh."""
    from scipy.sparse import csr_array

    parents = np.arange(len(mesh.cells)) if mesh.parents is None else mesh.parents
    shape = int(parents.max()) + 1, len(mesh.vertices)
    matrix = csr_array((mesh.corner_weights.ravel(), (np.repeat(parents, 4), mesh.cells.ravel())), shape=shape)
    matrix.sum_duplicates()
    return _VertexWeights(matrix, matrix.T.tocsr())


def _sweep(weights: _VertexWeights, some, target, result, low, high, settled: float, sweeps: int) -> None:
    """Sweep over some of the flow's cells and the vertices that belong to no other cells, in place.

    Ends when no deficit has changed by more than `settled` in CHECK_INTERVAL sweeps.
    """
    share, size, target = weights.matrix[some], weights.cell_total[some], target[some]
    if len(some) < len(weights.cell_total):
        count = np.bincount(share.indices, minlength=len(result))
        vertex = np.flatnonzero((count > 0) & (count == np.diff(weights.transposed.indptr)))
    else:
        vertex = np.arange(len(result))
    inner = share.tocsc()[:, vertex].tocsr()
    transposed = inner.T.tocsr()
    values, low, high = result[vertex], low[vertex], high[vertex]
    wanted = target * size - share @ result + inner @ values
    total = np.asarray(weights.matrix.sum(axis=0))[vertex]
    rate = np.where(total > 0.0, 1.0 / np.where(total > 0.0, total, 1.0), 0.0)
    before, ahead, restart = np.full(len(target), np.inf), values, 0
    for sweep in range(sweeps):
        deficit = (wanted - inner @ ahead) / size
        if sweep % CHECK_INTERVAL == 0:
            if np.abs(deficit - before).max() <= settled:
                break
            before = deficit
        moved = np.clip(ahead + rate * (transposed @ deficit), low, high)
        step = moved - values
        if np.sum((ahead - moved) * total * step) > 0.0:  # not by BLAS, whose threads cost more time than they save
            restart = sweep
        ahead = moved + (sweep - restart) / (sweep - restart + 3.0) * step
        values = moved
    result[vertex] = values


def _vertices_at(mesh: QuadMesh, points: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices at some points, and the mean of the values at each."""
    from scipy.spatial import KDTree

    distance, vertex = KDTree(mesh.vertices).query(points)
    near = distance < 1e-8 * float(np.ptp(mesh.vertices, axis=0).max())
    count = np.bincount(vertex[near], minlength=len(mesh.vertices))
    some = np.flatnonzero(count)
    return some, np.bincount(vertex[near], values[near], len(mesh.vertices))[some] / count[some]


def _bounds(share, transposed, target, smooth, values, vacuum: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and greatest value allowed at each vertex, initial values included except near vacuum."""
    low, high = _extremes(transposed, target, target, values)
    wide = _extremes(transposed, *_extremes(share, low, high, target), values)
    single = np.diff(transposed.indptr) == 1  # one cell's average gives no range, so that of its neighbours is used
    low, high = np.where(single, wide[0], low), np.where(single, wide[1], high)
    touched = (transposed @ (~smooth).astype(float)) > 0.0
    more = 0.25 * (wide[1] - wide[0])
    least, greatest = np.where(touched, low, wide[0] - more), np.where(touched, high, wide[1] + more)
    least = np.minimum(least, values)
    if np.isfinite(vacuum):
        least = np.maximum(least, np.where(low > vacuum, vacuum + 0.1 * (low - vacuum), -np.inf))
    return least, np.maximum(greatest, values)


def _extremes(rows, low, high, empty) -> tuple[np.ndarray, np.ndarray]:
    """Return the least `low` and greatest `high` over each row's entries of a sparse matrix; `empty` for empty rows."""
    begin, some = rows.indptr[:-1], np.diff(rows.indptr) > 0
    least, greatest = np.array(empty, dtype=float), np.array(empty, dtype=float)
    least[some] = np.minimum.reduceat(low[rows.indices], begin[some])
    greatest[some] = np.maximum.reduceat(high[rows.indices], begin[some])
    return least, greatest
