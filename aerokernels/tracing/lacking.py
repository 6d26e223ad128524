"""What the interpolant of a flow given by averages over cells lacks of those averages, along undisturbed rays.

A continuous interpolant keeps the average of a cell but for what medium/kept_averages.py leaves: much beside a captured
shock, next to nothing elsewhere. Each cell's lack over the ray's way in it is what the interpolant misses of the line
integral, as far as averages define one: where in a cell the gas is, they do not say.
"""

import numpy as np

from ..medium import IndexField
from ..medium.mesh_columns import mesh_columns
from ..rays import RayBundle
from .stop import stop_distance


def lacking_columns(field: IndexField, rays: RayBundle, until) -> np.ndarray:
    """Integrals of what the cells lack, from the rays' starts to their stop [m], shape (ray_count,).

    Zero of fields on uniform grids, of values at vertices, and of rays that never leave a planar field.
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
