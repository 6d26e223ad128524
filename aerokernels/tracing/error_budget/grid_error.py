"""Estimate the OPD error of rays due to the interpolation of a uniform grid, along their straight lines.

The estimate of next_order.py is integrated by two Gauss points for each cell, or more, from where a ray enters the box,
or leaves the body in which it begins, to its stop or the end of the box. It is of first order in the contrast.
"""

import numpy as np

from ...medium import IndexField
from ...medium.grid import UniformGrid
from ...medium.next_order import next_order_error
from ...rays import RayBundle
from ..lines import box_span, cell_along
from ..stop import stop_distance

# Gauss points of a piece as shares of its length.
GAUSS = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
# Pieces of a line for each cell: slopes that jump at faces of cells need more of them.
PIECES = {"cubic": 1.0, "linear": 4.0, "monotone": 4.0}
# Least and greatest number of pieces of a line.
LEAST_PIECES, MOST_PIECES = 8, 2048


def greatest(errors: np.ndarray) -> float:
    """Return the greatest error that estimates and bounds of the rest, shape (2, n), allow [m]; 0 for no rays."""
    return float((np.abs(errors[0]) + errors[1]).max(initial=0.0))


def spread(errors: np.ndarray) -> float:
    """Return the greatest standard deviation over the rays that estimates and bounds, shape (2, n), allow [m]."""
    return float(np.std(errors[0]) + np.sqrt(np.mean(errors[1] ** 2))) if errors.size else 0.0


def grid_error(field: IndexField, rays: RayBundle, until) -> np.ndarray:
    """Return the estimated OPD errors due to the interpolation, and bounds of the rest [m], shape (2, ray_count).

    Both are 0 for a field on a mesh.
    """
    found = np.zeros((2, rays.ray_count))
    if not isinstance(field.samples, UniformGrid):
        return found
    p, d = rays.position, rays.direction
    span = box_span(field, p, d)
    enter, leave = span.enter, np.minimum(span.leave, stop_distance(p, d, until))
    if field.body is not None:
        walls = field.body.crossings(p, d)
        first = np.where(walls > 0.0, walls, np.inf).min(axis=1, initial=np.inf)
        begins_inside = np.count_nonzero(walls <= 0.0, axis=1) % 2 == 1
        enter = np.where(begins_inside, np.maximum(enter, first), enter)
    rows = np.flatnonzero((leave > enter) & np.isfinite(leave))
    if not len(rows):
        return found
    p, d, enter, length = p[rows], d[rows], enter[rows], (leave - enter)[rows]
    cells = float(np.max(length / cell_along(field, d)))
    pieces = int(np.clip(np.ceil(cells * PIECES[field.interpolation]), LEAST_PIECES, MOST_PIECES))
    share = ((np.arange(pieces)[:, None] + GAUSS) / pieces).ravel()
    points = p[:, None] + (enter[:, None] + length[:, None] * share)[..., None] * d[:, None]
    local = field.local_coordinates(points.reshape(-1, 3)).reshape(*points.shape[:2], -1)
    local = np.clip(local, field.samples.low, field.samples.high)  # rounding at the box's faces
    weight = np.repeat(length[:, None] / len(share), len(share), axis=1)
    found[:, rows] = next_order_error(field.samples, local, weight)
    return found
