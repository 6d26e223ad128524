"""Ray bundles: start points, directions and weights of rays."""

import weakref
from collections.abc import Hashable
from dataclasses import dataclass
from functools import cached_property, partial
from hashlib import blake2b
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from aerokernels.derived import ReadOnly
from aerokernels.device_arrays import DeviceArray, device_array, is_one_row, plain_array, read_on_touch, rows_beside
from aerokernels.display.shown import shown
from aerokernels.inputs.arguments import GREAT, SMALL, Numbers, checked
from aerokernels.pupils import (
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
from aerokernels.pupils.base import SAMPLINGS, lengths
from aerokernels.pupils.square_map import RING, SquareMap

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


def _rows_or_one(rows: np.ndarray) -> np.ndarray:
    """Return a copy of an array, or only of its first row if all rows are equal."""
    alike = len(rows) > 1 and all((rows[k] == rows[0]).all() for k in (len(rows) // 2, -1))
    return np.array(rows[:1] if alike and (rows == rows[0]).all() else rows, order="C")


# Rays of a bundle from whose results the tracing of the others is planned.
PILOT_RAYS = 512
# Larger bundles, and those on a device, are in the keys of caches by identity: to read all rays would take too long.
KEYED_RAYS = 1 << 16  # speed only
# The unit disc as a pupil.
UNIT_DISC = SquareMap(RING, 0, 0, np.zeros(1))


@checked
@shown
@read_on_touch("position", "direction")
@dataclass(frozen=True, eq=False)
class RayBundle(ReadOnly):
    """Rays to trace.

    Positions and directions may be arrays of any library that has DLPack or `__cuda_array_interface__` (NumPy, CuPy,
    PyTorch, JAX, Warp). Arrays on a GPU stay there: Warp traces them on their CUDA device, and `position` and
    `direction` are copied to the host when they are first read.

    Attributes:
        position: Start points [m], shape (ray_count, 3).
        direction: Unit tangents, shape (ray_count, 3); normalised here. Parallel rays share one row in memory.
        weight: Weight of each ray in means over the bundle, shape (ray_count,); the sum is 1.

    Raises:
        ValueError: Shapes that disagree, numbers that are not finite, zero directions, negative weights, or positions
            and directions on two devices.
    """

    position: np.ndarray
    direction: np.ndarray
    weight: np.ndarray | None = None

    if TYPE_CHECKING:  # anything that NumPy makes an array of is accepted

        def __init__(self, position: ArrayLike, direction: ArrayLike, weight: ArrayLike | None = None) -> None: ...  # noqa: D107

    def __post_init__(self):
        """Check, normalise, and make read-only copies."""
        on_device = [device_array(each) for each in (self.position, self.direction)]
        if any(each is not None for each in on_device):
            self._take_from_device(*on_device)
            return
        position = np.atleast_2d(np.array(plain_array(self.position), dtype=np.float64, order="C"))
        direction = np.atleast_2d(np.asarray(plain_array(self.direction), dtype=np.float64))
        if position.shape == (0, 3):
            raise ValueError("the bundle holds no ray: give at least one position")
        if position.ndim != 2 or position.shape[1] != 3 or len(position) == 0:
            raise ValueError(f"ray positions must have shape (ray_count, 3), got {np.shape(self.position)}")
        if direction.ndim != 2 or direction.shape[1] != 3:
            raise ValueError(f"ray directions must have shape (ray_count, 3), got {np.shape(self.direction)}")
        if len(direction) not in (1, len(position)):
            raise ValueError(f"{len(position)} ray positions but {len(direction)} directions: give one for each")
        direction = _rows_or_one(direction)
        for name, array in (("position", position), ("direction", direction)):
            if not np.isfinite(array).all():
                bad = ~np.isfinite(array).all(axis=1)
                count = int(bad.sum()) * (len(position) // len(array))
                raise ValueError(f"{count} ray {name}s are not finite, the first is ray {int(np.argmax(bad))}")
        # Unit vectors keep their last bit, so that a part of a bundle has exactly the bundle's directions.
        with np.errstate(over="ignore"):
            turned = np.flatnonzero(~(np.abs(lengths(direction) - 1.0) <= 4e-16))
        if len(turned):
            part = direction if len(turned) == len(direction) else direction[turned]
            x, y, z = np.abs(part).T
            scale = np.maximum(np.maximum(x, y), z)  # max(axis=1) over rows of three takes five times as long
            if not scale.all():
                zero = turned[scale == 0.0]
                count = len(zero) * (len(position) // len(direction))
                raise ValueError(f"{count} ray directions are zero, the first is ray {zero[0]}")
            part = part / scale[:, None]
            direction[turned] = part / lengths(part)[:, None]
        if len(direction) < len(position):
            direction = np.broadcast_to(direction, position.shape)
        weight = self._shares(len(position))
        for name, array in (("position", position), ("direction", direction), ("weight", weight)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def _shares(self, count: int) -> np.ndarray:
        """Return the weights, scaled to a sum of 1."""
        if self.weight is None:
            return np.full(count, 1.0 / count)
        weight = np.array(plain_array(self.weight), dtype=np.float64)
        if weight.shape != (count,) or not np.isfinite(weight).all() or (weight < 0).any() or not weight.any():
            raise ValueError("ray weights must be finite, not negative and not all zero, one for each ray")
        if not SMALL <= weight.max() <= GREAT:
            raise ValueError(f"the greatest ray weight is {weight.max():g}: scale the weights to about 1")
        return np.asarray(weight / weight.sum())

    def _take_from_device(self, position: Any, direction: Any) -> None:
        """Take over positions and directions of which at least one is on a device; None if it is on the host."""
        from aerokernels.device_arrays.rays import checked_rays

        position, direction = checked_rays(
            plain_array(self.position) if position is None else position,
            plain_array(self.direction) if direction is None else direction,
        )
        count = len(position)
        weight = np.broadcast_to(1.0 / count, count) if self.weight is None else self._shares(count)
        weight.setflags(write=False)
        for name, array in (("position", position), ("direction", direction), ("weight", weight)):
            object.__setattr__(self, name, array)

    def held(self, name: str) -> Any:
        """Return `position` or `direction` as it is stored: a DeviceArray if it is on a device."""
        return self.__dict__[name]

    def on_device(self, name: str) -> Any:
        """Return `position` [m] or `direction` without a copy: a warp.array of vectors on a device, or a NumPy array.

        Both have DLPack; an array on a GPU also has `__cuda_array_interface__`.
        """
        found = self.held(name)
        return found.buffer if isinstance(found, DeviceArray) else found

    @property
    def device(self) -> str | None:
        """Warp's name of the device that holds the rays; None if they are NumPy arrays."""
        found = self.__dict__["position"]
        return found.device if isinstance(found, DeviceArray) else None

    @property
    def ray_count(self) -> int:
        """Number of rays."""
        return len(self.__dict__["position"])

    def __len__(self) -> int:
        """Number of rays."""
        return len(self.__dict__["position"])

    def __getitem__(self, rows) -> "RayBundle":
        """Return the rays of a slice or index array, with their weights scaled to a sum of 1."""
        position, direction = self.__dict__["position"][rows], self.__dict__["direction"][rows]
        return RayBundle(position, direction, np.atleast_1d(np.asarray(self.weight)[rows]))

    def rows(self, rows) -> "RayBundle":
        """Return the rays of a slice or index array with equal weights; only these are copied from a device.

        They were checked with the bundle, and are not checked again.
        """
        position, direction = self.__dict__["position"], self.__dict__["direction"]
        if not isinstance(rows, slice) and not len(rows):
            raise ValueError("these rows hold no ray")
        if isinstance(position, DeviceArray) and not isinstance(rows, slice):
            there = rows_beside(position, rows)  # uploaded once for both
            found = [each.part(there) for each in (position, direction)]
            return self.of_units(*(each.host for each in found))
        position = np.ascontiguousarray(position[rows])
        if is_one_row(direction):
            return self.of_units(position, np.broadcast_to(direction[:1], position.shape))
        return self.of_units(position, np.ascontiguousarray(direction[rows]))

    @cached_property
    def key(self) -> Hashable:
        """A key for caches that differs for other rays; for up to KEYED_RAYS on the host it is equal for equal ones."""
        if self.device is not None or self.ray_count > KEYED_RAYS:
            return weakref.ref(self)
        direction = self.direction[:1] if is_one_row(self.direction) else self.direction
        digest = blake2b(digest_size=32)
        for array in (self.position, direction, np.asarray(self.weight)):
            digest.update(np.ascontiguousarray(array).data)
        return self.ray_count, digest.digest()

    @cached_property
    def pilot(self) -> "RayBundle":
        """Up to PILOT_RAYS of the rays, evenly spread over their order: their results show how to trace the others."""
        return self.rows(np.linspace(0, self.ray_count - 1, min(PILOT_RAYS, self.ray_count)).round().astype(int))

    def part(self, rows: Any) -> "RayBundle":
        """Return the rays of some rows (an array of NumPy's or Warp's, or Rows) with equal weights, on their device."""
        if self.device is None:
            return self.rows(plain_array(rows))
        position, direction = (self.held(name).part(rows) for name in ("position", "direction"))
        return self._of(position, direction, np.broadcast_to(1.0 / len(rows), len(rows)))

    @classmethod
    def of_units(cls, position: np.ndarray, direction: np.ndarray) -> "RayBundle":
        """Return rays of positions (n, 3) and unit vectors (n, 3) that are known to be valid and that no one else uses.

        Nothing is checked or copied: for millions of rays either takes longer than tracing them.
        """
        for array in (position, direction):
            array.setflags(write=False)
        return cls._of(position, direction, np.broadcast_to(1.0 / len(position), len(position)))

    @classmethod
    def _of(cls, position: Any, direction: Any, weight: np.ndarray) -> "RayBundle":
        """Return rays from arrays that need no check."""
        bundle = cls.__new__(cls)
        weight.setflags(write=False)
        for name, array in (("position", position), ("direction", direction), ("weight", weight)):
            object.__setattr__(bundle, name, array)
        return bundle

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
        device: str | None = None,
    ) -> "RayBundle":
        """Return parallel rays through a pupil, along its normal unless a `direction` is given.

        With a Warp `device` ("cuda:0", "cpu") the rays are made and stay there; they are the same except for rounding.
        """
        along = pupil.normal if direction is None else as_unit_vector(direction, "direction")
        if device is not None:
            return cls._of_pupil("collimated", device, pupil, along, ray_count, sampling, seed)
        points, weight = pupil.sample(ray_count, sampling, seed)
        return cls(points, along[None], weight)

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
        device: str | None = None,
    ) -> "RayBundle":
        """Return rays from the point `apex` [m] into the cone of `half_angle` [rad] about `axis`.

        The rays are uniform in solid angle. With a Warp `device` ("cuda:0", "cpu") they are made and stay there; they
        are the same except for rounding.
        """
        if not (0.0 < half_angle <= np.pi):
            raise ValueError(f"half_angle must lie in (0, pi] rad, got {half_angle!r}")
        normal = as_unit_vector(axis, "axis")
        first, second = transverse_axes(normal)
        if device is not None:
            from aerokernels.device_arrays.rays import Made, sampled_rays

            made = Made(
                "divergent", as_vector(apex, "apex"), first, second, normal, 2.0 * np.sin(0.5 * half_angle) ** 2
            )
            samples = partial(unit_disc_samples, ray_count, sampling, seed)
            return cls._of(*sampled_rays(device, made, UNIT_DISC, samples, ray_count, sampling, seed))
        flat, weight = unit_disc_samples(ray_count, sampling, seed)
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
        device: str | None = None,
    ) -> "RayBundle":
        """Return rays from the point `from_point` [m] through the pupil's points.

        With `toward_point` the rays run along the same lines in the opposite direction, from the pupil's points toward
        the point; by reciprocity they have the same optical path. With a Warp `device` ("cuda:0", "cpu") they are made
        and stay there; they are the same except for rounding.
        """
        apex = as_vector(from_point, "from_point")
        if device is not None:
            kind = "to point" if toward_point else "from point"
            return cls._of_pupil(kind, device, pupil, apex, ray_count, sampling, seed)
        points, weight = pupil.sample(ray_count, sampling, seed)
        line = points - apex
        if toward_point:
            return cls(points, -line, weight)
        return cls(np.tile(apex, (len(points), 1)), line, weight)

    @classmethod
    def _of_pupil(
        cls, kind: str, device: str, pupil: Pupil, axis: np.ndarray, ray_count: int, sampling: str, seed: int
    ) -> "RayBundle":
        """Return rays from a pupil's points, made on a device."""
        from aerokernels.device_arrays.rays import Made, sampled_rays

        made = Made(kind, pupil.center, *pupil.axes, axis, pupil.reach)
        samples = partial(pupil.flat_sample, ray_count, sampling, seed)
        return cls._of(*sampled_rays(device, made, pupil.square_map, samples, ray_count, sampling, seed))
