"""When a bundle is collimated along z in a volume, and what its kernel needs then: see projection_tables.py.

The tables serve every ray that runs along z from one plane to another. Rays that come near a side of the box are
traced as usual, and the results are merged.
"""

import weakref
from dataclasses import dataclass

import numpy as np

from ..device_arrays import DeviceArray, extremes_of
from ..medium import IndexField
from ..medium.grid import UniformGrid
from ..rays import RayBundle
from .projection_tables import FURTHEST, ProjectionTables, between_projections, projection_tables
from .result import output_mask
from .stop import Plane

# Rays for each node of the grid from which on tables are made: fewer rays are traced sooner than tables are made.
RAYS_PER_NODE = 0.15
# "auto" takes them where the tolerance is at least MARGIN times the estimated error, and where the terms beyond the
# first order, which are splined between the grid's lines along z, are below GREATEST_EXTRA tolerances.
MARGIN = 3.0
GREATEST_EXTRA = 100.0
# Outputs for which a kernel looks up twice as much, so that it is built with and without them.
ENDS = frozenset(("position", "arc_length", "step_error"))
# The error between the grid's lines along z is computed only where its bound is above this share of the tolerance.
NEGLIGIBLE = 0.05


@dataclass(frozen=True, eq=False)
class Projection:
    """Rays along z, and the tables they need.

    Attributes:
        tables: What they gather.
        sign: 1.0 along z, -1.0 against it.
        first: Plane where the tables begin [m].
        last: Plane where they end [m].
        length: How far they reach [m].
        flight: How far it is from there to the stop [m].
        inside: Which rays the tables hold for, shape (ray_count,).
    """

    tables: ProjectionTables
    sign: float
    first: float
    last: float
    length: float
    flight: float
    inside: np.ndarray


def is_collimated(field: IndexField, rays: RayBundle, until) -> bool:
    """Whether the tables apply: all rays along z, in a cubic volume without a body, out of the box or to a plane."""
    if not (isinstance(field.samples, UniformGrid) and field.geometry == "volume" and field.body is None):
        return False
    if field.interpolation != "cubic" or not (until is None or isinstance(until, Plane)) or not rays.ray_count:
        return False
    first = rays.held("direction")[:1][0]
    if abs(first[2]) != 1.0 or not _are_all(rays.held("direction"), first * [0.0, 0.0, 1.0]):
        return False
    return until is None or abs(until.normal[2]) == 1.0


def _are_all(directions: np.ndarray | DeviceArray, one: np.ndarray) -> bool:
    """Whether directions (n, 3) are all the same one; on a device they are looked at there."""
    if isinstance(directions, DeviceArray):
        ends = extremes_of(directions)
        return bool((ends.low == one).all() and (ends.high == one).all())
    return bool((directions == one).all())


def is_worth_it(field: IndexField, rays: RayBundle) -> bool:
    """Whether there are enough rays for tables to save time."""
    return rays.ray_count >= RAYS_PER_NODE * field.samples.samples.size


def find_projection(field: IndexField, rays: RayBundle, until) -> Projection | None:
    """The tables for a bundle that `is_collimated`; None where rays begin in different planes or are deflected too far.

    The last result is kept with the field, because the plan needs it before the trace does.
    """
    key = ("projection of the last bundle", weakref.ref(rays), until)
    found: Projection | None = field.derive(key, lambda: _find_projection(field, rays, until), 1)
    return found


def _find_projection(field: IndexField, rays: RayBundle, until) -> Projection | None:
    grid = field.samples
    sign = float(rays.held("direction")[:1][0, 2])
    near, far = (grid.low[2], grid.high[2]) if sign > 0.0 else (grid.high[2], grid.low[2])
    ends = extremes_of(rays.held("position"))
    begins = np.maximum(np.array([ends.low[2], ends.high[2]]) * sign, near * sign)
    if begins.min() != begins.max() or begins[0] >= far * sign:
        return None
    first = float(begins[0] * sign)
    stop = far if until is None else float(until.point[2])
    last = min(stop * sign, far * sign) * sign
    if (last - first) * sign <= 1e-9 * abs(far - near):
        return None
    tables = projection_tables(field, sign, first, last)
    if not tables.greatest_shift <= FURTHEST:
        return None
    # A ray may not leave by a side: it keeps twice the greatest shift away from it.
    keep = 2.0 * tables.greatest_shift * grid.spacing[:2]
    low, high = grid.low[:2] + keep, grid.high[:2] - keep
    if (ends.low[:2] >= low).all() and (ends.high[:2] <= high).all():
        inside = np.broadcast_to(True, rays.ray_count)
    else:
        across = rays.position[:, :2]
        inside = np.asarray(((across >= low) & (across <= high)).all(axis=1))
    return Projection(tables, sign, first, last, abs(last - first), (stop - last) * sign, inside)


def projection_holds(field: IndexField, projection: Projection, budget: float) -> bool:
    """Whether the estimated errors of the tables are within an OPD error of `budget` [m].

    A direction is the slope of the path. It may be off by the budget over a cell, which a path right to the budget does
    not exclude; behind the box, its error lengthens the way of a ray that is turned. The error between the grid's lines
    along z is computed where its bound is not negligible.
    """
    tables = projection.tables
    beyond = float(np.abs(tables.extra[..., 0]).max())
    if MARGIN * tables.greatest_error > budget or beyond > GREATEST_EXTRA * budget:
        return False
    reach = max(float(np.min(field.samples.spacing[:2])), projection.flight * tables.greatest_deflection)
    if tables.between_bound * reach <= NEGLIGIBLE * budget * float(np.min(field.samples.spacing[:2])):
        return True
    between = between_projections(field, projection.sign, projection.first, projection.last)
    turned = between.direction * reach
    return MARGIN * max(between.path, turned) <= budget and between.extra <= GREATEST_EXTRA * budget


def kernel_numbers(field: IndexField, projection: Projection, outputs: frozenset) -> list[float]:
    """The scalar arguments of the kernel up to the rays: from cells_x to outputs."""
    grid = field.samples
    cells = [count - 1 for count in grid.shape[:2]]
    place = [*map(float, grid.origin[:2]), *(1.0 / float(h) for h in grid.spacing[:2])]
    way = [projection.sign, projection.first, projection.length, projection.flight]
    return [*cells, *place, field.ambient_index, *way, output_mask(outputs)]


def packed(tables: ProjectionTables) -> np.ndarray:
    """The kernel's array: for each (x, y) A, D and EXTRAS, flat."""
    return np.concatenate([np.stack([tables.path, tables.shift], axis=-1), tables.extra], axis=-1).ravel()
