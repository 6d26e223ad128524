"""Place points across the beam, trace the outward paths through the flow to them, and compute the returning power.

The points are those at which the undisturbed rays of the beam would cross the plane through the target's centre normal
to the axis (x and y of eq 8-12). The beam's support is limited to three 1/e^2 radii (4e-9 of the power is outside), and
to the reflector's edges where those are nearer. The result is a convex polygon. It is divided into bands at the heights
of its corners, and each band, a trapezium, gets a tensor product of Gauss-Legendre points. With 20 points across or
more the fractions add up to the power within 1e-7.
A tilted reflector spreads the echo in time by its depth. If this spread is long compared with the pulse, points are
added until four of them fall within the pulse's timescale; otherwise the echo would be a series of separate pulses.

A ray leaves the exit aperture at the homologous point: its distance from the axis in exit radii equals its distance at
the target in beam radii. The diverging beam therefore sees a point (X, Y, Z) of the tilted reflector, relative to the
reflector's centre, at

    (x, y) = (X, Y) / (1 + q Z),  q = (1 - exit_radius / radius) / distance

which maps the reflector's straight edges to straight edges.

One ray per target point leaves the exit aperture and ends on the tilted target. R_L = integral of n ds inside the
traced field plus the ambient index times the straight remainder (eq 9, with lengths and optical lengths distinguished).
The path ends on the tilted plane, so R_L includes the effect of the tilt. The pulse takes the time of the group path
along the same ray, the integral of the group index: n_g - 1 of air is 1.4 % more than n - 1 at 905 nm. The incidence is
cos = -d . N in three dimensions.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from aerokernels.inputs.checks import check_aperture
from aerokernels.lidar.parts import Setup
from aerokernels.lidar.pulses import SPEED_OF_LIGHT
from aerokernels.lidar.radiometry import plane_echo_power
from aerokernels.medium import IndexField
from aerokernels.process.opened import OPENED
from aerokernels.pupils.base import lengths
from aerokernels.rays import RayBundle
from aerokernels.tracing import TraceResult, trace

SUPPORT = 3.0  # [1/e^2 radii]


LEAST_BAND = 8  # points across a band, however narrow


PANEL_NODES = 64  # greatest number of Gauss-Legendre points in one piece; computing n points takes a time of order n^3


@dataclass(frozen=True)
class TargetPoints:
    """Rays of the beam.

    Attributes:
        aim: Where the undisturbed rays cross the plane normal to the axis at the target's centre [m], shape (m, 3).
        start: Where they leave the exit aperture [m], shape (m, 3).
        weight: Fraction of the beam's power, shape (m,); the sum is the fraction that meets the reflector.
    """

    aim: np.ndarray
    start: np.ndarray
    weight: np.ndarray


def target_points(setup: Setup, finer: float = 1.0) -> TargetPoints:
    """Return the rays of the beam over which an echo is summed.

    Args:
        setup: The laser and its target; `ray_count` of the laser is rounded up to a square, at least 400, and more if
            the reflector's edges divide the beam into bands or a tilt spreads the echo over many pulse lengths.
        finer: Multiplies the points along each side of the beam.

    Raises:
        ValueError: A target that reaches back to the aperture's plane, or one so deep against the pulse that millions
            of points would be needed.
    """
    laser = setup.laser
    reach = SUPPORT * laser.radius
    if setup.target.limits == "paper":
        outline = _rectangle(reach, laser.radius)
    else:
        outline = clip_polygon(seen_outline(setup), _rectangle(reach, reach))
    side = max(math.ceil(math.sqrt(laser.ray_count)), 20)  # points across the whole beam
    across, along = (math.ceil(finer * max(side, count)) for count in _resolving_counts(setup, outline))
    if across * along > 1 << 22:
        raise ValueError(
            f"the target is deep against the pulse: {across} x {along} points of the beam would be needed to sum up "
            "its echo; take a longer beam.pulse_tau, or a smaller target.tilt or beam.radius"
        )
    flat, area = polygon_points(outline, across, along)
    density = 2.0 / (math.pi * laser.radius**2) * np.exp(-2.0 * np.sum(flat**2, axis=1) / laser.radius**2)
    return TargetPoints(*_rays(setup, flat), density * area)


def _rays(setup: Setup, flat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return aim and start [m], (m, 3) each, of rays through points (m, 2) of the plane at the target's centre."""
    start_z, ratio = setup.receiver.aperture_z, setup.laser.exit_radius / setup.laser.radius
    aim = np.column_stack([flat, np.full(len(flat), start_z + setup.target.distance)])
    return aim, np.column_stack([ratio * flat, np.full(len(flat), start_z)])


def _resolving_counts(setup: Setup, outline: np.ndarray) -> tuple[int, int]:
    """Return the numbers of points in x and in y that resolve the echo's spread over the reflector's depth."""
    flat, _ = polygon_points(outline, LEAST_BAND)
    aim, start = _rays(setup, flat)
    ray, normal = aim - start, setup.target.normal
    # From the exit to the tilted plane, which crosses the axis at the centre of the plane of `aim`.
    center = np.array([0.0, 0.0, aim[0, 2]])
    path = lengths(ray) * ((center - start) @ normal) / (ray @ normal)
    sides = np.column_stack([np.ones(len(flat)), flat])
    slope = np.linalg.lstsq(sides, path, rcond=None)[0]
    residual = float(np.ptp(path - sides @ slope))
    depth = np.abs(slope[1:]) * np.ptp(outline, axis=0) + residual
    # Gauss points are pi / 2 times farther apart in the middle than on average; four are to fall within the depth that
    # light travels, out and back, in one timescale of the pulse.
    step = 0.5 * SPEED_OF_LIGHT * setup.laser.shape.timescale / (0.5 * math.pi * 4.0)
    across, along = (math.ceil(length / step) for length in depth)
    return across, along


def _rectangle(half_width: float, half_height: float) -> np.ndarray:
    return np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * (half_width, half_height)


def seen_outline(setup: Setup) -> np.ndarray:
    """Return the reflector's corners as the beam sees them in the plane of its centre [m], in order, shape (4, 2).

    Raises:
        ValueError: The reflector reaches back to the aperture's plane.
    """
    laser, target = setup.laser, setup.target
    corner = target.corners
    divergence = (1.0 - laser.exit_radius / laser.radius) / target.distance
    scale = 1.0 + divergence * corner[:, 2]
    if scale.min() <= 0.0 or corner[:, 2].min() <= -target.distance:
        raise ValueError(
            f"the target reaches back to the aperture: {target.width:g} m x {target.height:g} m at a tilt of "
            f"{target.tilt:g} rad and a distance of {target.distance:g} m; take a smaller tilt or height or width"
        )
    return corner[:, :2] / scale[:, None]


def clip_polygon(outline: np.ndarray, window: np.ndarray) -> np.ndarray:
    """Return the part of a convex polygon inside a convex window, both counterclockwise, shape (n, 2); it may be empty.

    I. Sutherland, G. Hodgman, Reentrant polygon clipping, Comm. ACM 17 (1974): clip at one edge of the window after the
    other.
    """
    inner = outline
    for first, second in zip(window, np.roll(window, -1, axis=0), strict=True):
        if not len(inner):
            break
        along = second - first
        inside = along[0] * (inner[:, 1] - first[1]) - along[1] * (inner[:, 0] - first[0])
        corners: list[np.ndarray] = []
        for k in range(len(inner)):
            here, there = inside[k - 1], inside[k]
            if (here >= 0.0) != (there >= 0.0):
                corners.append(inner[k - 1] + here / (here - there) * (inner[k] - inner[k - 1]))
            if there >= 0.0:
                corners.append(inner[k])
        inner = np.array(corners).reshape(-1, 2)
    return inner


def polygon_points(outline: np.ndarray, across: int, along: int | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return Gauss-Legendre points in a convex polygon.

    Args:
        outline: Its corners [m], counterclockwise, shape (n, 2).
        across: Points across its width, in x.
        along: Points across its height, in y; None: as many as across.

    Returns:
        Points [m], shape (m, 2), and the area that each represents [m2], shape (m,).
    """
    rows = across if along is None else along
    levels = np.sort(outline[:, 1])
    # Corners whose heights differ by less than this fraction of the whole count as level: no band is made between
    # them.
    levels = levels[np.append(True, np.diff(levels) > 1e-9 * (levels[-1] - levels[0]))]
    column, column_weight = _gauss_points(across)
    points, areas = [], []
    for low, high in pairwise(levels):
        count = max(math.ceil(rows * (high - low) / (levels[-1] - levels[0])), min(LEAST_BAND, rows))
        node, weight = _gauss_points(count)
        y = 0.5 * (high + low) + 0.5 * (high - low) * node
        left, right = _width_at(outline, y)
        x = 0.5 * (left + right)[:, None] + 0.5 * (right - left)[:, None] * column
        points.append(np.stack([x, np.broadcast_to(y[:, None], x.shape)], axis=-1).reshape(-1, 2))
        areas.append((0.5 * (high - low) * weight[:, None] * 0.5 * (right - left)[:, None] * column_weight).ravel())
    return np.concatenate(points), np.concatenate(areas)


def _gauss_points(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return at least `count` Gauss-Legendre points in [-1, 1] and their weights, in equal pieces if there are many."""
    piece_count = math.ceil(count / PANEL_NODES)
    rule = math.ceil(count / piece_count)  # at most PANEL_NODES rules are cached
    node, weight = OPENED.once(("Gauss-Legendre", rule), lambda: np.polynomial.legendre.leggauss(rule))
    middle = (2.0 * np.arange(piece_count) + 1.0) / piece_count - 1.0
    return (middle[:, None] + node / piece_count).ravel(), np.tile(weight / piece_count, piece_count)


def _width_at(outline: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the leftmost and rightmost x [m] of a convex polygon at heights between its corners [m]."""
    left, right = np.full(y.shape, np.inf), np.full(y.shape, -np.inf)
    for first, second in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        rise = second[1] - first[1]
        if rise == 0.0:
            continue
        share = (y - first[1]) / rise
        met = (share >= -1e-9) & (share <= 1.0 + 1e-9)
        x = first[0] + share * (second[0] - first[0])
        left[met], right[met] = np.minimum(left[met], x[met]), np.maximum(right[met], x[met])
    return left, right


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
