"""Trace the outward paths, through the flow to the target, and compute the power that returns from each of its points.

One ray per target point leaves the exit aperture and ends on the tilted target. R_L = integral of n ds inside the
traced field plus the ambient index times the straight remainder (eq 9, with lengths and optical lengths distinguished).
The path ends on the tilted plane, so R_L includes the effect of the tilt. The pulse takes the time of the group path
along the same ray, the integral of the group index: n_g - 1 of air is 1.4 % more than n - 1 at 905 nm. The incidence is
cos = -d . N in three dimensions.
"""

import math
from dataclasses import dataclass

import numpy as np

from aerokernels.echo.parts import Setup
from aerokernels.echo.radiometry import plane_echo_power
from aerokernels.echo.target_points import TargetPoints
from aerokernels.inputs.checks import check_aperture
from aerokernels.medium import IndexField
from aerokernels.pupils.base import lengths
from aerokernels.rays import RayBundle
from aerokernels.tracing import TraceResult, trace


@dataclass(frozen=True)
class TransmitPaths:
    """The outward paths, one per target point.

    Attributes:
        intersection: Where each ray meets the target [m], shape (m, 3).
        direction: Unit tangent there, shape (m, 3).
        deflection: Deflection by the flow, toward x and y [rad], shape (m, 2).
        path: Optical path R_L from the exit aperture to the target [m], shape (m,).
        group_path: The same with the group index, which is what a pulse travels [m], shape (m,).
        incidence_cosine: Cosine of the angle between ray and target normal, shape (m,).
        arrived: Whether the ray reached the target, shape (m,).
        trace: The trace, or None in vacuum.
    """

    intersection: np.ndarray
    direction: np.ndarray
    deflection: np.ndarray
    path: np.ndarray
    group_path: np.ndarray
    incidence_cosine: np.ndarray
    arrived: np.ndarray
    trace: TraceResult | None = None


def vacuum_paths(setup: Setup, points: TargetPoints) -> TransmitPaths:
    """Return the outward paths in vacuum, which are straight lines."""
    plane, line = setup.plane, points.aim - points.start
    direction = line / lengths(line)[:, None]
    cosine = direction @ plane.normal
    path = ((plane.point - points.start) @ plane.normal) / cosine
    intersection = points.start + path[:, None] * direction
    deflection = np.zeros((len(path), 2))
    return TransmitPaths(intersection, direction, deflection, path, path, cosine, np.ones(len(path), dtype=bool))


def transmit_paths(setup: Setup, field: IndexField, points: TargetPoints) -> TransmitPaths:
    """Trace the outward paths through the flow; paths and intersection are NaN for rays that do not arrive."""
    plane = setup.plane
    rays = RayBundle(points.start, points.aim - points.start)
    wanted = ("position", "direction", "group_path", "evaluation_count")
    result = trace(field, rays, until=plane, outputs=wanted, **setup.options)
    position, direction, path, group_path = result.position, result.direction, result.optical_path, result.group_path
    assert position is not None and direction is not None  # requested outputs
    assert path is not None and group_path is not None
    intersection, direction = (np.where(result.ok[:, None], values, np.nan) for values in (position, direction))
    return TransmitPaths(
        intersection=intersection,
        direction=direction,
        deflection=(direction - rays.direction)[:, :2],
        path=np.where(result.ok, path, np.nan),
        group_path=np.where(result.ok, group_path, np.nan),
        incidence_cosine=direction @ plane.normal,
        arrived=result.ok,
        trace=result,
    )


def point_power(setup: Setup, weight: np.ndarray, paths: TransmitPaths, factor: np.ndarray | float) -> np.ndarray:
    """Return the peak power of each point's pulse at the receiver [W], shape (m,).

    Args:
        setup: The laser, target and receiver.
        weight: Fraction of the beam's power at each point, shape (m,).
        paths: The paths to the points.
        factor: Fraction of each point's light that the flow transmits on its way back, shape (m,).

    Raises:
        ValueError: The receiver is wider than its target is far.
    """
    target, receiver = setup.target, setup.receiver
    check_aperture(receiver.equal_diameter, target.distance)
    to_receiver = np.array([0.0, 0.0, receiver.aperture_z]) - paths.intersection
    to_receiver = to_receiver / lengths(to_receiver)[:, None]
    normal = target.normal
    mirrored = paths.direction - 2.0 * (paths.direction @ normal)[:, None] * normal
    whole = plane_echo_power(
        setup.laser.peak_power,
        receiver.equal_diameter,
        paths.path,
        np.maximum(paths.incidence_cosine, 0.0),
        target.reflector.reflectance(np.sum(mirrored * to_receiver, axis=1)),
        target.transmission,
        receiver.efficiency,
    )
    return weight * factor * whole


def still_air(field: IndexField, distance: float) -> float:
    """Return the excess of the group path over a distance [m] through the ambient air alone."""
    made = field.upstream
    index = field.ambient_index if made is None or made.group is None else made.group.ambient_index
    return (index - 1.0) * distance


def air_error(field: IndexField, distance: float) -> float:
    """Return what the refractivity model's uncertainty makes of that excess [m]; NaN, not known, for raw contrast."""
    made = field.upstream
    if made is None:
        return math.nan
    return (made.refractivity if made.group is None else made.group.uncertainty) * abs(still_air(field, distance))
