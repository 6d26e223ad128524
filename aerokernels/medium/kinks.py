"""Kinks of an interpolant on a mesh: how much its gradient jumps at the edges between cells.

Error control steps over edges only where their kinks allow it (tracing/engines/warp/kernels/edges.py).
"""

from collections.abc import Callable

import numpy as np

from .mesh import QuadMesh

# Places along an edge at which both sides are compared: along it the gradient of a bilinear interpolant changes slowly.
PLACES = (0.0, 0.5, 1.0)
# Cells that are compared with their neighbours at a time.
PART = 1 << 17  # memory only


def gradient_jumps(mesh: QuadMesh, gradient_in: Callable[..., np.ndarray]) -> np.ndarray:
    """Return the greatest jump of the gradient at each edge of each cell [1/m], shape (cell_count, 4).

    At the boundary, where there is no other side, it is 0.

    Args:
        mesh: The mesh.
        gradient_in: Returns the gradients [1/m] in cells (n,) at points (n, 2) [m] with bilinear coordinates.
    """
    jumps = np.zeros(mesh.cells.shape)
    across = mesh.neighbors
    for first in range(0, len(across), PART):
        part = across[first : first + PART]
        # Each edge is compared once, for the cell of the lower number, and counts for both.
        row, edge = np.nonzero(part > np.arange(first, first + len(part))[:, None])
        cell, other = row + first, part[row, edge]
        back = (across[other] == cell[:, None]).argmax(axis=1)
        greatest = np.zeros(len(cell))
        for place in PLACES:
            point = (1.0 - place) * mesh.corners[cell, edge] + place * mesh.corners[cell, (edge + 1) % 4]
            # The neighbour's edge runs the other way round.
            near = gradient_in(cell, point, *_on_edge(edge, place))
            far = gradient_in(other, point, *_on_edge(back, 1.0 - place))
            greatest = np.maximum(greatest, np.hypot(*(near - far).T))
        jumps[cell, edge] = jumps[other, back] = greatest
    return jumps


def _on_edge(edge: np.ndarray, place: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the bilinear coordinates of a place along each of the edges, which are numbered from 0 to 3."""
    xi = np.array([place, 1.0, 1.0 - place, 0.0])[edge]
    return xi, np.roll([place, 1.0, 1.0 - place, 0.0], 1)[edge]
