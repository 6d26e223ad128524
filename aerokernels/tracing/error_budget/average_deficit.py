"""Integrate the deficit of an interpolant of cell averages along undisturbed rays.

A continuous interpolant does not keep the average of every cell exactly (medium/averages/kept_averages.py): the deficit
is large beside a captured shock, and nearly zero elsewhere. The deficit of each cell times the length of the ray in it
is the error of the line integral, as far as averages define one: they do not say where in a cell the gas is.
"""

import numpy as np

from ...medium import IndexField
from ...medium.mesh_columns import mesh_columns
from ...rays import RayBundle
from ..stop import stop_distance


def deficit_integrals(field: IndexField, rays: RayBundle, until) -> np.ndarray:
    """Integrals of the cells' deficits, from the rays' starts to their stop [m], shape (ray_count,).

    Zero for fields on uniform grids, for values at vertices, and for rays that never leave a planar field.
    """
    found = np.zeros(rays.ray_count)
    known = None if field.is_uniform else field.samples.lacking_by_cell
    if known is None or not known[1].any():
        return found
    mesh, lacks = known
    rows = np.arange(rays.ray_count)
    if field.geometry == "planar":
        rows = np.flatnonzero(np.hypot(rays.direction[:, 1], rays.direction[:, 2]) > 0.0)
    position, direction = rays.position[rows], rays.direction[rows]
    ends = np.stack([np.zeros(len(rows)), stop_distance(position, direction, until)])
    found[rows] = mesh_columns(mesh, lacks, position, direction, ends)
    return found
