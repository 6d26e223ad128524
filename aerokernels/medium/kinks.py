"""Kinks of an interpolant on a mesh: how much its gradient jumps at the edges between cells.

Error control steps over edges only where their kinks allow it (tracing/engines/warp/kernels/edges.py).
"""

from collections.abc import Callable

import numpy as np

from .mesh import QuadMesh
from .mesh_cells import PART

# Places along an edge at which both sides are compared: along it the gradient of a bilinear interpolant changes slowly.
PLACES = (0.0, 0.5, 1.0)


def bilinear_jumps(mesh: QuadMesh, values: np.ndarray) -> np.ndarray:
    """Return the greatest jump of the bilinear interpolant's gradient at each edge of each cell [1/m], as below.

    It jumps along the normal of the edge only, which is faster to compute; `values` are those at the vertices.
    """

    def changes(cell: np.ndarray, edge: np.ndarray, other: np.ndarray, back: np.ndarray) -> list[np.ndarray]:
        near, far = _rises(mesh, values, cell, edge), _rises(mesh, values, other, back)
        # The neighbour's edge runs the other way round, and its inside is on the other side.
        return [np.abs(one + two) for one, two in zip(near, reversed(far), strict=True)]

    return _greatest(mesh, changes)


def gradient_jumps(mesh: QuadMesh, gradient_in: Callable[..., np.ndarray]) -> np.ndarray:
    """Return the greatest jump of the gradient at each edge of each cell [1/m], shape (cell_count, 4).

    At the boundary, where there is no other side, it is 0.

    Args:
        mesh: The mesh.
        gradient_in: Returns the gradients [1/m] in cells (n,) at points (n, 2) [m] with bilinear coordinates.
    """

    def changes(cell: np.ndarray, edge: np.ndarray, other: np.ndarray, back: np.ndarray) -> list[np.ndarray]:
        return [_change(mesh, gradient_in, cell, edge, other, back, place) for place in PLACES]

    return _greatest(mesh, changes)


def _greatest(mesh: QuadMesh, changes: Callable[..., list[np.ndarray]]) -> np.ndarray:
    """Return the greatest of the `changes` (cell, edge, cell behind, its edge) at each edge, shape (cell_count, 4)."""
    jumps = np.zeros(mesh.cells.shape, dtype=np.float32)  # of millions of cells, and only sizes
    across = mesh.neighbors
    for first in range(0, len(across), PART):
        part = across[first : first + PART]
        # Each edge is compared once, for the cell of the lower number, and counts for both.
        row, edge = np.nonzero(part > np.arange(first, first + len(part))[:, None])
        cell, other = row + first, part[row, edge]
        back = (across[other] == cell[:, None]).argmax(axis=1)
        jumps[cell, edge] = jumps[other, back] = np.maximum.reduce(changes(cell, edge, other, back))
    return jumps


def _rises(mesh: QuadMesh, values: np.ndarray, cell: np.ndarray, edge: np.ndarray) -> list[np.ndarray]:
    """Return the slopes of the bilinear interpolant into cells, along the normals of their edges, at each place."""
    corner = [mesh.cells[cell, (edge + k) % 4] for k in (0, 1, 2, 3)]
    (y0, z0), (y1, z1), (y2, z2), (y3, z3) = (mesh.vertices[k].T for k in corner)
    v0, v1, v2, v3 = (values[k] for k in corner)
    length = np.hypot(y1 - y0, z1 - z0)
    ahead, aside, rise = (y1 - y0) / length, (z1 - z0) / length, (v1 - v0) / length
    found = []
    for place in PLACES:
        # The other family of the bilinear map's lines, from the edge into the cell.
        y, z, v = (
            (1.0 - place) * a + place * b for a, b in ((y3 - y0, y2 - y1), (z3 - z0, z2 - z1), (v3 - v0, v2 - v1))
        )
        found.append((v - (y * ahead + z * aside) * rise) / (z * ahead - y * aside))
    return found


def _change(mesh, gradient_in, cell, edge, other, back, place: float) -> np.ndarray:
    """Return how much the gradient changes across edges at one place."""
    point = (1.0 - place) * mesh.corners[cell, edge] + place * mesh.corners[cell, (edge + 1) % 4]
    near = gradient_in(cell, point, *_on_edge(edge, place))
    far = gradient_in(other, point, *_on_edge(back, 1.0 - place))
    return np.hypot(*(near - far).T)


def _on_edge(edge: np.ndarray, place: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the bilinear coordinates of a place along each of the edges, which are numbered from 0 to 3."""
    xi = np.array([place, 1.0, 1.0 - place, 0.0])[edge]
    return xi, np.roll([place, 1.0, 1.0 - place, 0.0], 1)[edge]
