"""Ray bundles: where light starts, in which direction, and with what share of the whole."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from .arguments import Numbers, checked
from .pupils import (
    Annulus,
    Disc,
    Mask,
    Polygon,
    Pupil,
    Rectangle,
    as_unit_vector,
    as_vector,
    transverse_axes,
    unit_disc_samples,
)
from .pupils.base import SAMPLINGS
from .read_only import ReadOnly
from .shown import shown

__all__ = [
    "SAMPLINGS",
    "Annulus",
    "Disc",
    "Mask",
    "Polygon",
    "Pupil",
    "RayBundle",
    "Rectangle",
    "as_unit_vector",
    "as_vector",
    "transverse_axes",
    "unit_disc_samples",
]


@checked
@shown
@dataclass(frozen=True, eq=False)
class RayBundle(ReadOnly):
    """Rays to trace.

    Attributes:
        position: Start points [m], shape (ray_count, 3).
        direction: Unit tangents, shape (ray_count, 3); normalised here.
        weight: Share of each ray in means over the bundle, sums to 1, shape (ray_count,).

    Raises:
        ValueError: Shapes that disagree, numbers that are not finite, zero directions, negative weights.
    """

    position: np.ndarray
    direction: np.ndarray
    weight: np.ndarray | None = None

    if TYPE_CHECKING:  # arrays are made of what is given

        def __init__(self, position: ArrayLike, direction: ArrayLike, weight: ArrayLike | None = None) -> None: ...  # noqa: D107

    def __post_init__(self):
        """Check, normalise, and make read-only copies."""
        position = np.atleast_2d(np.array(self.position, dtype=np.float64))
        direction = np.atleast_2d(np.array(self.direction, dtype=np.float64))
        if position.ndim != 2 or position.shape[1] != 3 or len(position) == 0:
            raise ValueError(f"ray positions must have shape (ray_count, 3), got {np.shape(self.position)}")
        if direction.ndim != 2 or direction.shape[1] != 3:
            raise ValueError(f"ray directions must have shape (ray_count, 3), got {np.shape(self.direction)}")
        if len(direction) == 1 and len(position) > 1:
            direction = np.repeat(direction, len(position), axis=0)
        if position.shape != direction.shape:
            raise ValueError(f"{len(position)} ray positions but {len(direction)} directions: give one for each")
        for name, array in (("position", position), ("direction", direction)):
            bad = ~np.isfinite(array).all(axis=1)
            if bad.any():
                raise ValueError(f"{bad.sum()} ray {name}s are not finite, the first is ray {int(np.argmax(bad))}")
        scale = np.abs(direction).max(axis=1)
        if (scale == 0.0).any():
            zero = int(np.argmax(scale == 0.0))
            raise ValueError(f"{int((scale == 0.0).sum())} ray directions are zero, the first is ray {zero}")
        # Directions that are unit vectors already stay as they are, to the last bit: a part of a bundle is that part.
        with np.errstate(over="ignore"):
            turned = ~(np.abs(np.linalg.norm(direction, axis=1) - 1.0) <= 4e-16)
        direction[turned] /= scale[turned, None]
        direction[turned] /= np.linalg.norm(direction[turned], axis=1, keepdims=True)
        weight = np.full(len(position), 1.0) if self.weight is None else np.array(self.weight, dtype=np.float64)
        if weight.shape != (len(position),) or not np.isfinite(weight).all() or (weight < 0).any() or weight.sum() <= 0:
            raise ValueError("ray weights must be finite, not negative and not all zero, one for each ray")
        for name, array in (("position", position), ("direction", direction), ("weight", weight / weight.sum())):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def ray_count(self) -> int:
        """Number of rays."""
        return len(self.position)

    def __len__(self) -> int:
        """Number of rays."""
        return len(self.position)

    def __getitem__(self, rows) -> "RayBundle":
        """The rays of a slice or index array."""
        return RayBundle(self.position[rows], self.direction[rows], np.atleast_1d(np.asarray(self.weight)[rows]))

    @classmethod
    @checked
    def collimated(
        cls,
        pupil: Pupil,
        ray_count: int = 1024,
        *,
        direction: Numbers | None = None,
        sampling: str = "sobol",
        seed: int = 0,
    ) -> "RayBundle":
        """Parallel rays through a pupil, along its normal unless a `direction` is given."""
        points, weight = pupil.sample(ray_count, sampling, seed)
        along = pupil.normal if direction is None else as_unit_vector(direction, "direction")
        return cls(points, np.tile(along, (len(points), 1)), weight)

    @classmethod
    @checked
    def divergent(
        cls,
        apex: Numbers,
        axis: Numbers,
        half_angle: float,
        ray_count: int = 1024,
        *,
        sampling: str = "sobol",
        seed: int = 0,
    ) -> "RayBundle":
        """Rays from the point `apex` [m] into the cone of `half_angle` [rad] about `axis`, uniform in solid angle."""
        if not (0.0 < half_angle <= np.pi):
            raise ValueError(f"half_angle must lie in (0, pi] rad, got {half_angle!r}")
        flat, weight = unit_disc_samples(ray_count, sampling, seed)
        normal = as_unit_vector(axis, "axis")
        first, second = transverse_axes(normal)
        # Equal areas of the disc map to equal solid angles: 1 - cos(polar) is linear in the disc's r^2.
        squared = np.sum(flat**2, axis=1)
        lag = squared * 2.0 * np.sin(0.5 * half_angle) ** 2
        sine = np.sqrt(lag * (2.0 - lag))
        azimuth = np.arctan2(flat[:, 1], flat[:, 0])
        across = np.cos(azimuth)[:, None] * first + np.sin(azimuth)[:, None] * second
        direction = (1.0 - lag)[:, None] * normal + sine[:, None] * across
        return cls(np.tile(as_vector(apex, "apex"), (len(flat), 1)), direction, weight)

    @classmethod
    @checked
    def through(
        cls,
        pupil: Pupil,
        from_point: Numbers,
        ray_count: int = 1024,
        *,
        sampling: str = "sobol",
        seed: int = 0,
        toward_point: bool = False,
    ) -> "RayBundle":
        """Rays from the point `from_point` [m] through the pupil's points.

        With `toward_point` the same lines are launched the other way: from the pupil's points toward the point,
        which by reciprocity see the same optical path.
        """
        points, weight = pupil.sample(ray_count, sampling, seed)
        apex = as_vector(from_point, "from_point")
        line = points - apex
        if toward_point:
            return cls(points, -line, weight)
        return cls(np.tile(apex, (len(points), 1)), line, weight)
