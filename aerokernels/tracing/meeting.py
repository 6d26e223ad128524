"""Find which straight rays meet a field and its body, and reject a bundle of which none meets the field."""

import numpy as np

from ..derived import cached_on
from ..medium import IndexField
from ..medium.grid import UniformGrid
from ..rays import RayBundle
from .lines import BOXES, box_span, bundle_span

CHUNK = 1 << 14


class NoRayMeetsField(ValueError):
    """A bundle of which no ray meets the field's box ahead of its start."""


def greatest_contrast(field: IndexField) -> float:
    """Greatest |contrast| of the field's samples."""
    if isinstance(field.samples, UniformGrid):
        low, high = field.samples.extremes
        return max(high, -low)
    values = field.samples.values
    return field.samples.derive("greatest contrast", lambda: float(max(values.max(), -values.min())))


@cached_on("rays", BOXES)
def is_any_meeting(rays: RayBundle, geometry: str, low: np.ndarray, high: np.ndarray) -> bool:
    """Whether any ray of a bundle meets a field's box, given by its corners in x, y, z [m], ahead of its start."""
    if bundle_span(rays.pilot, geometry, low, high).meets.any():  # nearly always
        return True
    chunks = (rays.rows(slice(first, first + CHUNK)) for first in range(0, rays.ray_count, CHUNK))
    return any(bundle_span(chunk, geometry, low, high).meets.any() for chunk in chunks)


def check_meeting(field: IndexField, rays: RayBundle, what: str) -> None:
    """Reject a bundle of which no ray meets the field's box ahead of its start; a field without contrast is accepted.

    Raises:
        NoRayMeetsField: No ray meets the box; the message gives the positions of box and rays and says what to check.
    """
    low, high = field.box
    if is_any_meeting(rays, field.geometry, low, high) or greatest_contrast(field) == 0.0:
        return
    box = ", ".join(
        f"{axis} from {a:.4g} to {b:.4g} m" for axis, a, b in zip("xyz", low, high, strict=True) if np.isfinite(b - a)
    )
    place, along = rays.position.mean(axis=0), rays.direction.mean(axis=0)
    raise NoRayMeetsField(
        f"no {what} meets the field, whose box is {box}: the rays start about ({place[0]:.4g}, {place[1]:.4g}, "
        f"{place[2]:.4g}) m and go toward ({along[0]:.3g}, {along[1]:.3g}, {along[2]:.3g}); check the units (metres "
        "are expected), the direction and the position"
    )


def walls_along(field: IndexField, position: np.ndarray, direction: np.ndarray, end) -> tuple[np.ndarray, np.ndarray]:
    """Where straight lines through a field begin: 0, or where one that starts in the body leaves it [m], shape (n,).

    Also which of them end on the body, shape (n,): they enter it before they leave the field's box or reach `end` [m],
    or they start in it and never leave it there. A line along x through planar air never leaves the field and is not
    counted.
    """
    assert field.body is not None
    span = box_span(field, position, direction)
    walls = field.body.crossings(position, direction)
    walls = np.pad(walls, ((0, 0), (0, 2)), constant_values=np.inf)
    before = np.count_nonzero((walls <= span.enter[:, None]) & np.isfinite(walls), axis=1)
    inside = before % 2 == 1
    rows = np.arange(len(walls))
    leaves, enters = walls[rows, before], walls[rows, before + inside]
    last = np.minimum(span.leave, end)
    ended = span.meets & (span.leave < 1e30) & ((enters <= last) | inside & (leaves > last))
    return np.where(inside, leaves, 0.0), ended


def meets_wall(field: IndexField, position: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Which straight rays end on the body, see `walls_along`, shape (n,)."""
    return walls_along(field, position, direction, np.inf)[1]
