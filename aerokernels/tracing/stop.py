"""Stops of a trace, a plane or a length of path, and the status of a ray, which says whether and how it got there.

Without a stop, None, a ray ends where it leaves the field's box.

A planar field has no ends in x: light along the unit vector d crosses it by p = |(d_y, d_z)| a metre, and moves in y
and z as through a contrast m / p^2. For contrasts up to NEARLY_TRAPPED p^2 that makes the way longer by less than the
share ROOM (1 - p^2); light nearer to the x axis may be guided along the field, and no plane is beyond it.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..inputs.arguments import checked
from ..medium import IndexField
from ..medium.grid import UniformGrid
from ..rays import Pupil, as_unit_vector, as_vector
from .scheme import LEAST_SLOPE


@checked
@dataclass(frozen=True, eq=False)
class Plane:
    """The plane through `point` [m] across `normal` (made a unit vector); both of shape (3,)."""

    point: np.ndarray
    normal: np.ndarray

    if TYPE_CHECKING:  # the attributes are arrays, made from whatever is given

        def __init__(self, point: ArrayLike, normal: ArrayLike) -> None: ...  # noqa: D107

    def __post_init__(self):
        """Check and normalise."""
        object.__setattr__(self, "point", as_vector(self.point, "Plane point"))
        object.__setattr__(self, "normal", as_unit_vector(self.normal, "Plane normal"))

    @property
    def key(self) -> tuple[bytes, bytes]:
        """A key for caches that is equal for equal stops."""
        return self.point.tobytes(), self.normal.tobytes()


@checked
@dataclass(frozen=True, eq=False)
class ArcLength:
    """A length [m] along each ray from its start."""

    length: float

    def __post_init__(self):
        """Check the length."""
        if not (np.isfinite(self.length) and self.length >= 0.0):
            raise ValueError(f"ArcLength needs a finite length of at least 0 m, got {self.length!r}")

    @property
    def key(self) -> float:
        """A key for caches that is equal for equal stops."""
        return self.length


def stop_distance(position: np.ndarray, direction: np.ndarray, until) -> np.ndarray:
    """Distance to the stop along straight lines [m], infinite where they never meet it, shape (n,)."""
    if isinstance(until, ArcLength):
        return np.full(len(position), until.length)
    if not isinstance(until, Plane):
        return np.full(len(position), np.inf)
    height, slope = (until.point - position) @ until.normal, direction @ until.normal
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        distance = height / slope
    return np.where((distance >= 0.0) & ((np.abs(slope) > LEAST_SLOPE) | (height == 0.0)), distance, np.inf)


def greatest_contrast(field: IndexField) -> float:
    """Greatest |contrast| of the field's samples."""
    if isinstance(field.samples, UniformGrid):
        low, high = field.samples.extremes
        return max(high, -low)
    values = field.samples.values
    return field.samples.derive("greatest contrast", lambda: float(max(values.max(), -values.min())))


# Over the size of the box: how far beyond it a stop is at least, so that they never are the same surface.
CLEARANCE = 1e-3
ROOM, NEARLY_TRAPPED = 0.125, 1.0 / 32.0
Box = tuple[np.ndarray, np.ndarray]  # lowest and highest corner [m], infinite along an axis without ends


def ways_through(box: Box, start: np.ndarray, look: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lengths [m] along unit vectors from points (.., 3) to the middle of a box and to beyond it, and p^2."""
    ends = np.isfinite(box[1] - box[0])
    low, high = (np.where(ends, corner, 0.0) for corner in box)
    toward = np.where(ends, look, 0.0)
    square = np.sum(toward**2, axis=-1)
    middle, corner = 0.5 * (low + high), np.where(look > 0.0, high, low)
    lengths = (np.sum((place - start) * toward, axis=-1) / np.maximum(square, 1e-300) for place in (middle, corner))
    return *lengths, square


def way_beyond(box: Box, start: np.ndarray, reach: float, look: np.ndarray, contrast: float = 0.0) -> np.ndarray:
    """The length [m] along unit vectors beyond which light from within `reach` [m] of a point is beyond the box.

    Raises:
        ValueError: A planar field of so great a contrast that light along a unit vector may never leave it.
    """
    _, end, square = ways_through(box, start, look)
    ends = np.isfinite(box[1] - box[0])
    slowest, least = float(np.min(square)), contrast / NEARLY_TRAPPED
    if not ends.all() and not slowest > least:
        near, limit = (np.degrees(np.arcsin(np.sqrt(min(part, 1.0)))) for part in (slowest, least))
        raise ValueError(
            f"a planar field never ends along x, and light at {near:.2g} degrees from x may not leave it: look more "
            f"than {limit:.2g} degrees away from x, or give the air as a volume"
        )
    size = float(np.linalg.norm(np.where(ends, box[1] - box[0], 0.0)))
    length = np.maximum(end, 0.0) + (reach + CLEARANCE * size) / np.sqrt(square)
    return np.asarray(length * (1.0 + ROOM * np.maximum(1.0 - square, 0.0)))


def plane_beyond(field: IndexField, pupil: Pupil, look: np.ndarray) -> Plane:
    """The plane across a unit vector, beyond a field for all light of a pupil along it; see `way_beyond`."""
    way = way_beyond(field.box, pupil.center, pupil.reach, look, greatest_contrast(field))
    return Plane(pupil.center + way * look, look)


class RayStatus(IntEnum):
    """Status codes of traced rays, the same numbers in every kernel."""

    OK = 0
    MISSED_FIELD = 1
    STOP_NOT_REACHED = 2
    HIT_BODY = 3
    INSIDE_BODY = 4
    MAX_STEPS = 5
    NOT_FINITE = 6
    LEFT_DISTURBED_AIR = 7
    TOLERANCE_NOT_MET = 8

    @property
    def meaning(self) -> str:
        """What happened."""
        return _TEXT[self][0]

    @property
    def remedy(self) -> str:
        """What to do about it."""
        return _TEXT[self][1]


_TEXT = {
    RayStatus.OK: ("the ray reached the stop", "nothing to do"),
    RayStatus.MISSED_FIELD: (
        "the ray never meets the field's box, so it cannot leave it",
        "aim the ray at the box, or stop on a Plane or at an ArcLength",
    ),
    RayStatus.STOP_NOT_REACHED: (
        "the plane is behind the ray or parallel to it (within 1e-9 rad), or the ray was turned away from it",
        "move the plane ahead of the rays, or turn its normal",
    ),
    RayStatus.HIT_BODY: (
        "the ray met the body and ends on its surface",
        "expected for rays that the body blocks; else check the body's profile and the ray's start",
    ),
    RayStatus.INSIDE_BODY: (
        "the ray starts behind the body's surface and never leaves it within the field's box",
        "move the start, or turn the ray toward the surface",
    ),
    RayStatus.MAX_STEPS: (
        "the ray took as many steps as allowed and had not arrived",
        "raise max_steps, loosen the tolerance, or look for a ray that is trapped in the field",
    ),
    RayStatus.NOT_FINITE: (
        "a number overflowed or was not a number",
        "trace in float64, or look for contrasts that are too strong for the step",
    ),
    RayStatus.LEFT_DISTURBED_AIR: (
        "the ray reached the stop, but the field was cut from a larger one (resample(region=), or a scene's grid), "
        "whose disturbed air outside the box is missing from its optical path",
        "give the field a larger region, move the rays, or read `truncation`, which is what is missing",
    ),
    RayStatus.TOLERANCE_NOT_MET: (
        "the ray reached the stop, but its own error estimate (step_error) is above the requested tolerance",
        "trace in float64, loosen the tolerance, or read the ray's step_error",
    ),
}

# Code by which the kernels that interpolate rays mark one without a patch, until it is traced; not a RayStatus.
NOT_DELIVERED = -1

# Rays with these statuses reached the stop: their results can be used, with the reservation that the status states.
REACHED = (RayStatus.OK, RayStatus.LEFT_DISTURBED_AIR, RayStatus.TOLERANCE_NOT_MET)


def reached(status: np.ndarray) -> np.ndarray:
    """Which of the status codes belong to rays that reached the stop, as booleans of the same shape."""
    status = np.asarray(status)
    found = status == int(REACHED[0])
    if not found.all():
        for other in REACHED[1:]:
            found |= status == int(other)
    return np.asarray(found)
