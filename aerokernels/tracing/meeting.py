"""Reject a bundle of which no ray meets the field: its result would be that of empty air."""

import weakref
from itertools import chain

import numpy as np

from ..medium import IndexField
from ..medium.grid import UniformGrid
from ..medium.grid_places import known
from ..rays import RayBundle
from .lines import box_span

CHUNK = 1 << 14
# Bundles whose test result is cached with a grid's node positions.
CACHED = 4  # speed only


class NoRayMeetsField(ValueError):
    """A bundle of which no ray meets the field's box ahead of its start."""


def greatest_contrast(field: IndexField) -> float:
    """Greatest |contrast| of the field's samples."""
    if isinstance(field.samples, UniformGrid):
        low, high = field.samples.extremes
        return max(high, -low)
    values = field.samples.values
    return field.samples.derive("greatest contrast", lambda: float(max(values.max(), -values.min())))


def is_any_meeting(field: IndexField, rays: RayBundle) -> bool:
    """Whether any ray of a bundle meets the field's box ahead of its start."""
    chunks = (slice(first, first + CHUNK) for first in range(0, rays.ray_count, CHUNK))
    parts = ((rays.held("position")[rows], rays.held("direction")[rows]) for rows in chunks)
    pilot = rays.pilot.position, rays.pilot.direction  # nearly always enough
    return any(box_span(field, *part).meets.any() for part in chain([pilot], parts))


def check_meeting(field: IndexField, rays: RayBundle, what: str) -> None:
    """Reject a bundle of which no ray meets the field's box ahead of its start; a field without contrast is accepted.

    Raises:
        NoRayMeetsField: No ray meets the box; the message gives the positions of box and rays and says what to check.
    """
    place = "meeting", field.geometry, weakref.ref(rays)
    if known(field.samples, place, lambda: is_any_meeting(field, rays), CACHED):
        return
    if greatest_contrast(field) == 0.0:
        return
    low, high = field.box
    box = ", ".join(
        f"{axis} from {a:.4g} to {b:.4g} m" for axis, a, b in zip("xyz", low, high, strict=True) if np.isfinite(b - a)
    )
    place, along = rays.position.mean(axis=0), rays.direction.mean(axis=0)
    raise NoRayMeetsField(
        f"no {what} meets the field, whose box is {box}: the rays start about ({place[0]:.4g}, {place[1]:.4g}, "
        f"{place[2]:.4g}) m and go toward ({along[0]:.3g}, {along[1]:.3g}, {along[2]:.3g}); check the units (metres "
        "are expected), the direction and the position"
    )
