"""Stops of a trace: a plane, or a length of path. None means that a ray ends where it leaves the field's box.

A planar field has no ends in x: light along the unit vector d crosses it by p = |(d_y, d_z)| a metre, and moves in y
and z as through a contrast m / p^2. For contrasts up to NEARLY_TRAPPED p^2 that makes the way longer by less than the
share ROOM (1 - p^2); light nearer to the x axis may be guided along the field, and no plane is beyond it.
"""

from dataclasses import dataclass
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
