"""A field on a mesh of four times the cells, from which the error of the bilinear interpolant is estimated.

New values are those of a cubic along every edge and of a Coons patch in every cell (S. A. Coons, MIT MAC-TR-41 (1967)),
of fourth order or of that of the gradients: the interpolation error of the finer cells is a quarter of that before,
that of slopes a half. Vertices that cut triangles and polygons have means of corners, and are first lifted to third
order.
"""

from dataclasses import replace

import numpy as np

from aerokernels.derived import cached_on
from aerokernels.medium.mesh import QuadMesh


def refined(field):
    """Return the field on cells cut in four; None where they make no valid mesh."""
    samples = field.samples
    if field.mesh.parents is not None and samples.averages is None:
        # Each part of a flow's cell begins with a corner of that cell; the other vertices of the part cut the cell.
        mesh, gradient = field.mesh, samples.gradients
        corner, cuts = mesh.cells[:, :1], mesh.cells[:, 1:]
        rise = np.sum(gradient[corner] * (mesh.vertices[cuts] - mesh.vertices[corner]), axis=-1).ravel()
        count = np.maximum(np.bincount(cuts.ravel(), minlength=len(samples.values)), 1)
        lifted = samples.values + 0.5 * np.bincount(cuts.ravel(), rise, len(samples.values)) / count
        samples = replace(samples, values=lifted)
    try:
        finer, values = cut_in_four(field.mesh, samples.values, samples.gradients)
    except ValueError:  # a mesh with a seam has two vertices in one place
        return None
    return replace(field, samples=replace(samples, mesh=finer, values=values, averages=None))


def cut_in_four(mesh: QuadMesh, values: np.ndarray, gradient: np.ndarray) -> tuple[QuadMesh, np.ndarray]:
    """Return the mesh with every cell cut in four, in the order of the cells, and values from those at its vertices."""
    finer, a, b, of_edge = _cut(mesh)
    rise = np.sum((gradient[a] - gradient[b]) * (mesh.vertices[b] - mesh.vertices[a]), axis=1)
    edge_value = 0.5 * (values[a] + values[b]) + 0.125 * rise
    cell_value = 0.5 * edge_value[of_edge].sum(axis=1) - values[mesh.cells].mean(axis=1)
    return finer, np.concatenate([values, edge_value, cell_value])


def cells_of_four(mesh: QuadMesh) -> QuadMesh:
    """Return the mesh with every cell cut in four parts, in the order of the cells."""
    return _cut(mesh)[0]


def quarters(xi: np.ndarray, eta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which of a cell's four parts contains each point, and the point's bilinear coordinates in that part."""
    right, upper = xi > 0.5, eta > 0.5
    part = np.where(upper, np.where(right, 2, 3), np.where(right, 1, 0))
    # The first corner of each part is the cell's corner, and the parts have the cell's orientation.
    u, v = 2.0 * np.where(right, 1.0 - xi, xi), 2.0 * np.where(upper, 1.0 - eta, eta)
    turned = right != upper
    return part, np.where(turned, v, u), np.where(turned, u, v)


@cached_on("mesh")
def has_seam(mesh: QuadMesh) -> bool:
    """Return whether a structured mesh closes on itself with two vertices in one place, so that it cannot be cut."""
    return mesh.shape is not None and len(np.unique(mesh.vertices, axis=0)) < len(mesh.vertices)


@cached_on("mesh")
def _cut(mesh: QuadMesh) -> tuple[QuadMesh, np.ndarray, np.ndarray, np.ndarray]:
    """Return the finer mesh, both ends of each edge, and the edges of each cell, shape (cell_count, 4)."""
    if has_seam(mesh):
        raise ValueError("the mesh has two vertices in one place, at a seam: its cells cannot be cut")
    vertex, cells = mesh.vertices, mesh.cells
    # An edge is numbered by the first of its cells.
    across = mesh.neighbors
    row, side = np.nonzero((across < 0) | (across > np.arange(len(cells))[:, None]))
    of_edge = np.empty(cells.shape, dtype=np.int64)
    of_edge[row, side] = np.arange(len(row))
    other = across[row, side]
    shared = np.flatnonzero(other >= 0)
    of_edge[other[shared], (across[other[shared]] == row[shared, None]).argmax(axis=1)] = shared
    a, b = np.sort(np.stack([cells[row, side], cells[row, (side + 1) % 4]]), axis=0)
    edge = len(vertex) + of_edge
    middle = len(vertex) + len(a) + np.arange(len(cells))[:, None]
    # Part k: corner k, the middle of the edge after it, the middle of the cell, the middle of the edge before it.
    quarters = [np.concatenate([cells[:, [k]], edge[:, [k]], middle, edge[:, [k - 1]]], axis=1) for k in range(4)]
    points = np.concatenate([vertex, 0.5 * (vertex[a] + vertex[b]), vertex[cells].mean(axis=1)])
    parents = np.repeat(np.arange(len(cells)) if mesh.parents is None else mesh.parents, 4)
    finer = QuadMesh(points, np.stack(quarters, axis=1).reshape(-1, 4), mesh.geometry, parents=parents, whole=mesh)
    return finer, a, b, of_edge
