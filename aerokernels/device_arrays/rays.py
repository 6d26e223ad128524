"""Rays on a device: checks of rays from other libraries, and rays made there."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from ..inputs.checks import check_count
from ..pupils.square_map import SquareMap
from ..sobol import sobol_numbers
from .array import DeviceArray
from .kernels import FAULTS, PLACE, WAY, ZERO, check_rays, make_rays
from .launching import launch
from .pinned import to_host


@dataclass(frozen=True, eq=False)
class Made:
    """How rays are made from points: see kernels.make_rays.

    Attributes:
        kind: "collimated", "from point", "to point" or "divergent".
        center: The pupil's centre, or the apex [m].
        first: First axis across.
        second: Second axis across.
        axis: Direction of parallel rays, the common point of rays from or to a point [m], or the axis of a cone.
        scale: The pupil's reach [m], or twice the squared sine of half the cone's half angle.
    """

    kind: str
    center: np.ndarray
    first: np.ndarray
    second: np.ndarray
    axis: np.ndarray
    scale: float


KINDS = ("collimated", "from point", "to point", "divergent")


def checked_rays(position: Any, direction: Any) -> tuple[DeviceArray, DeviceArray]:
    """Check and copy rays on a device, with normalised directions.

    Args:
        position: A warp.array of numbers, shape (ray_count, 3), or an array of this shape on the host.
        direction: Likewise, of as many rays or of one.

    Raises:
        ValueError: Shapes disagree, the arrays are on two devices, numbers are not finite, or a direction is zero.
    """
    device = next(each.device for each in (position, direction) if isinstance(each, wp.array))
    both = [_numbers(each, device) for each in (position, direction)]
    for array, what in zip(both, ("positions", "directions"), strict=True):
        if array.ndim != 2 or array.shape[1] != 3 or not len(array):
            raise ValueError(f"ray {what} must have shape (ray_count, 3), got {tuple(array.shape)}")
        if array.device != device:
            raise ValueError(
                f"ray positions and directions are on two devices, {device.alias} and {array.device.alias}"
            )
    count = len(both[0])
    if len(both[1]) not in (1, count):
        raise ValueError(f"{count} ray positions but {len(both[1])} directions: give one for each")
    faults = wp.array([0] * FAULTS + [count] * FAULTS, dtype=wp.int32, device=device)
    place, way = (wp.empty(count, dtype=wp.vec3d, device=device) for _ in range(2))
    launch(check_rays, count, [*both, faults, place, way], device)
    found = to_host(faults)
    words = {PLACE: "positions are not finite", WAY: "directions are not finite", ZERO: "directions are zero"}
    for kind, what in words.items():
        if found[kind]:
            raise ValueError(f"{found[kind]} ray {what}, the first is ray {found[kind + FAULTS]}")
    return DeviceArray(place), DeviceArray(way)


def _numbers(array: Any, device: Any) -> Any:
    """Return rays as float64 numbers on a device; an array that is there already is not copied."""
    if not isinstance(array, wp.array):
        return wp.array(np.atleast_2d(np.asarray(array, dtype=np.float64)), dtype=wp.float64, device=device)
    if array.dtype == wp.float64:
        return array
    made = wp.empty(array.shape, dtype=wp.float64, device=array.device)
    wp.utils.array_cast(array, made)
    return made


def sampled_rays(
    device: str,
    made: Made,
    points: SquareMap,
    samples: Callable[[], tuple[np.ndarray, np.ndarray]],
    ray_count: int,
    sampling: str,
    seed: int,
) -> tuple[DeviceArray, DeviceArray, np.ndarray]:
    """Make rays on a device, from Sobol points computed there or from the points and weights of `samples`.

    Returns:
        Positions and directions on the device, and weights on the host.
    """
    count = check_count(ray_count)
    if sampling == "sobol":
        return *made_rays(device, made, count, seed, points), np.broadcast_to(1.0 / count, count)
    flat, weight = samples()
    return *made_rays(device, made, len(flat), seed, flat), weight


def made_rays(
    device: str, made: Made, count: int, seed: int, points: SquareMap | np.ndarray
) -> tuple[DeviceArray, DeviceArray]:
    """Make positions and directions of rays on a device of Warp.

    Args:
        device: Name of the device, "cpu" or "cuda:0".
        made: How the rays are made.
        count: Number of rays.
        seed: Seed of the Sobol points.
        points: The map of the unit square to the pupil, or points on the pupil, shape (count, 2).

    Raises:
        ValueError: The device does not exist.
    """
    from ..process.quiet_warp import open_device

    try:
        found = open_device(device)
    except (ValueError, RuntimeError) as error:
        names = ", ".join(each.alias for each in wp.get_devices())
        raise ValueError(f"device {device!r} does not exist: rays can be made on {names}") from error
    if isinstance(points, SquareMap):
        start, directions = sobol_numbers(2, seed)
        numbers = [points.shape, points.row_count, points.column_count, _put(points.table, wp.float64, found)]
        flat = wp.zeros((0, 2), dtype=wp.float64, device=found)
    else:
        start, directions = np.zeros(2, np.uint32), np.zeros((2, 1), np.uint32)
        numbers = [0, 0, 0, _put(np.zeros(1), wp.float64, found)]
        flat = _put(points, wp.float64, found)
    place, way = (wp.empty(count, dtype=wp.vec3d, device=found) for _ in range(2))
    given = [KINDS.index(made.kind), flat, _put(start, wp.uint32, found), _put(directions, wp.uint32, found), *numbers]
    given += [wp.vec3d(*each) for each in (made.center, made.first, made.second, made.axis)]
    launch(make_rays, count, [*given, float(made.scale), place, way], found)
    return DeviceArray(place), DeviceArray(way)


def _put(values: np.ndarray, kind: type, device: Any) -> Any:
    return wp.array(np.ascontiguousarray(values), dtype=kind, device=device)
