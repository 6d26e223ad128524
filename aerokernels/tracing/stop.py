"""Stops of a trace: a plane, or a length of path. None means that a ray ends where it leaves the field's box."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..inputs.arguments import checked
from ..rays import as_unit_vector, as_vector
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
