"""Exact integrals of values that are constant in each cell of a mesh, along straight lines.

A line is cut where it crosses edges of cells (in an axisymmetric mesh: the cones that the edges sweep about the axis).
Each piece is in one cell, the one that contains its midpoint.
"""

import numpy as np

from aerokernels.derived import cached_on
from aerokernels.medium.bodies.crossings import as_lines, crossings
from aerokernels.medium.grid import local_coordinates
from aerokernels.medium.mesh import QuadMesh

LINES = 64  # lines that are cut together; speed only


def mesh_columns(mesh: QuadMesh, values: np.ndarray, position, direction, ends=None) -> np.ndarray:
    """Return integrals along lines of a value for each cell, shape (line_count,); zero outside the mesh.

    Args:
        mesh: The mesh, in (y, z) or (r, z).
        values: Value of each cell, shape (cell_count,).
        position: A point on each line [m], shape (line_count, 3) or (3,).
        direction: Unit vectors, shape (line_count, 3) or (3,).
        ends: Distances from its point at which each line begins and ends [m], shape (2, line_count); None takes whole
            lines.
    """
    position, direction = as_lines(position, direction)
    if not np.isfinite(position).all():
        raise ValueError("the points of lines must be finite")
    if mesh.geometry == "planar" and (np.hypot(direction[:, 1], direction[:, 2]) == 0.0).any():
        raise ValueError("lines along x never leave a planar mesh")
    ends = None if ends is None else np.asarray(ends, dtype=np.float64)
    if not len(position):
        return np.zeros(0)
    # The next call may have other values on the mesh along the same lines.
    # Of many lines nothing is cached.
    pieces = _pieces if len(position) <= 512 else _pieces.function
    line, cell, length = pieces(mesh, position, direction, ends)
    return np.bincount(line, np.where(cell >= 0, values[cell], 0.0) * length, len(position))


@cached_on("mesh")
def _pieces(mesh: QuadMesh, position: np.ndarray, direction: np.ndarray, ends) -> tuple[np.ndarray, ...]:
    """Return the pieces of lines between cuts: number of the line, cell (-1 for none), and length [m]."""
    edges = np.unique(np.sort(np.stack([mesh.cells, np.roll(mesh.cells, -1, axis=1)], axis=-1).reshape(-1, 2)), axis=0)
    start, end = mesh.vertices[edges[:, 0]], mesh.vertices[edges[:, 1]]
    if mesh.geometry == "axisymmetric":
        keep = (start[:, 0] > 0.0) | (end[:, 0] > 0.0)
        start, end = start[keep], end[keep]
    found = []
    for first in range(0, len(position), LINES):
        rows = slice(first, first + LINES)
        cuts = crossings(start, end, mesh.geometry, position[rows], direction[rows])
        if ends is not None:  # cuts before the beginning or after the end are moved there: their pieces have no length
            begins, stops = (np.asarray(own)[rows, None] for own in ends)
            outer = np.where(np.isfinite(stops), stops, np.inf)
            cuts = np.sort(np.concatenate([begins, np.clip(cuts, begins, stops), outer], axis=1), axis=1)
        ahead, behind = cuts[:, 1:], cuts[:, :-1]
        line, piece = np.nonzero(np.isfinite(ahead) & (ahead > behind))
        ahead, behind = ahead[line, piece], behind[line, piece]
        middle = 0.5 * (ahead + behind)
        at = position[rows][line] + middle[:, None] * direction[rows][line]
        cell = mesh.locate(local_coordinates(at, mesh.geometry))
        found.append((first + line, cell, ahead - behind))
    return tuple(np.concatenate(parts) for parts in zip(*found, strict=True))
