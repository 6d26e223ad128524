"""Place points across the beam, trace the outward paths through the flow to them, and compute the returning power.

The points are a tensor product of Gauss-Legendre points on the reflector, within three 1/e^2 radii of the beam (4e-9 of
the power is outside). With 20 points across the fractions add up to the power within 1e-7. One ray per point leaves the
exit aperture and ends on the tilted target; the pulse takes the time of the group path along the ray.
"""

import math
from dataclasses import dataclass

import numpy as np

from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.inputs.checks import (
    as_finite_array,
    check_aperture,
    check_choice,
    check_positive,
    check_share,
    check_tilt,
)
from aerokernels.lidar.parts import LIMITS, Setup
from aerokernels.lidar.pulses import SPEED_OF_LIGHT
from aerokernels.medium import IndexField
from aerokernels.process.opened import OPENED
from aerokernels.pupils.base import lengths
from aerokernels.rays import RayBundle
from aerokernels.tracing import TraceResult, trace


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
            a tilt spreads the echo over many pulse lengths.
        finer: Multiplies the points along each side of the beam.

    Raises:
        ValueError: A target that reaches back to the aperture's plane, or one so deep against the pulse that millions
            of points would be needed.
    """
    laser, target, reach = setup.laser, setup.target, 3.0 * setup.laser.radius
    # `seen` maps (u, v, 1) of the reflector to (s x, s y, s), where the beam sees it in the plane of its centre.
    if target.limits == "paper":
        seen, high = np.eye(3), np.array([reach, laser.radius])
        low = -high
    else:
        seen = _seen_reflector(setup)
        low, high = _lit_part(seen, 0.5 * np.array([target.width, target.height]), reach)
    side = max(math.ceil(math.sqrt(laser.ray_count)), 20)  # points across the whole beam
    shear = np.maximum(np.hypot(*seen[:2, :2]) * (high - low) / (2.0 * reach), 1.0)
    needed = np.maximum(side * shear, _resolving_counts(setup, seen, low, high))
    across, along = (math.ceil(finer * math.ceil(count)) for count in needed)
    if across * along > 1 << 22:
        raise ValueError(
            f"the target is deep against the pulse: {across} x {along} points of the beam would be needed to sum up "
            "its echo; take a longer beam.pulse_tau, or a smaller target.tilt or beam.radius"
        )
    _, flat, area = _grid(seen, low, high, across, along)
    density = 2.0 / (math.pi * laser.radius**2) * np.exp(-2.0 * np.sum(flat**2, axis=1) / laser.radius**2)
    return TargetPoints(*_rays(setup, flat), density * area)


def _seen_reflector(setup: Setup) -> np.ndarray:
    """Return the matrix (3, 3) from (u, v, 1) along the reflector's sides to (s x, s y, s) of the ray that meets it.

    A ray leaves the exit aperture at the homologous point: its distance from the axis in exit radii equals its distance
    at the target in beam radii. The diverging beam sees a point (X, Y, Z) of the reflector, relative to its centre, at
    (x, y) = (X, Y) / (1 + q Z), q = (1 - exit_radius / radius) / distance.
    """
    laser, target = setup.laser, setup.target
    divergence = (1.0 - laser.exit_radius / laser.radius) / target.distance
    sides, corner = target.orientation[:, :2], target.corners
    if (1.0 + divergence * corner[:, 2]).min() <= 0.0 or corner[:, 2].min() <= -target.distance:
        raise ValueError(
            f"the target reaches back to the aperture: {target.width:g} m x {target.height:g} m at a tilt of "
            f"{target.tilt:g} rad and a distance of {target.distance:g} m; take a smaller tilt or height or width"
        )
    return np.column_stack([np.vstack([sides[:2], divergence * sides[2:]]), [0.0, 0.0, 1.0]])


def _lit_part(seen: np.ndarray, half: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends in u and v [m], (2,) each, of the part of a reflector within `reach` of the axis in x and y."""
    window = np.array([[-reach, reach, reach, -reach], [-reach, -reach, reach, reach], [1.0, 1.0, 1.0, 1.0]])
    place = np.linalg.solve(seen, window)
    if place[2].min() <= 0.0:  # a ray at the window's edge runs along the reflector, or away from it
        return -half, half
    place = place[:2] / place[2]
    return np.maximum(-half, place.min(axis=1)), np.minimum(half, place.max(axis=1))


def _grid(
    seen: np.ndarray, low: np.ndarray, high: np.ndarray, across: int, along: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return Gauss-Legendre points, (u, v) and (x, y) [m], shape (m, 2), and the area in x and y of each [m2], (m,)."""
    (node_u, weight_u), (node_v, weight_v) = _gauss_points(across), _gauss_points(along)
    half = 0.5 * (high - low)
    u, v = np.meshgrid(0.5 * (low[0] + high[0]) + half[0] * node_u, 0.5 * (low[1] + high[1]) + half[1] * node_v)
    place = np.stack([u.ravel(), v.ravel(), np.ones(u.size)])
    x, y, scale = seen @ place
    area = half[0] * half[1] * np.outer(weight_v, weight_u).ravel() * np.linalg.det(seen) / scale**3
    return place[:2].T, np.column_stack([x, y]) / scale[:, None], area


def _gauss_points(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return at least `count` Gauss-Legendre points in [-1, 1] and their weights, in equal pieces of at most 64."""
    piece_count = math.ceil(count / 64)  # computing n points takes a time of order n^3
    rule = math.ceil(count / piece_count)
    node, weight = OPENED.once(("Gauss-Legendre", rule), lambda: np.polynomial.legendre.leggauss(rule))
    middle = (2.0 * np.arange(piece_count) + 1.0) / piece_count - 1.0
    return (middle[:, None] + node / piece_count).ravel(), np.tile(weight / piece_count, piece_count)


def _rays(setup: Setup, flat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return aim and start [m], (m, 3) each, of rays through points (m, 2) of the plane at the target's centre."""
    start_z, ratio = setup.receiver.aperture_z, setup.laser.exit_radius / setup.laser.radius
    aim = np.column_stack([flat, np.full(len(flat), start_z + setup.target.distance)])
    return aim, np.column_stack([ratio * flat, np.full(len(flat), start_z)])


def _resolving_counts(setup: Setup, seen: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the numbers of points in u and in v that resolve the echo's spread over the reflector's depth, (2,).

    Four points fall within the pulse's timescale; otherwise the echo would be a series of separate pulses.
    """
    place, flat, _ = _grid(seen, low, high, 8, 8)
    aim, start = _rays(setup, flat)
    ray, normal = aim - start, setup.target.normal
    # From the exit to the tilted plane, which crosses the axis at the centre of the plane of `aim`.
    center = np.array([0.0, 0.0, aim[0, 2]])
    path = lengths(ray) * ((center - start) @ normal) / (ray @ normal)
    sides = np.column_stack([np.ones(len(place)), place])
    slope = np.linalg.lstsq(sides, path, rcond=None)[0]
    depth = np.abs(slope[1:]) * (high - low) + np.ptp(path - sides @ slope)
    # Gauss points are pi / 2 times farther apart in the middle than on average; four are to fall within the depth that
    # light travels, out and back, in one timescale of the pulse.
    return depth / (0.5 * SPEED_OF_LIGHT * setup.laser.shape.timescale / (0.5 * math.pi * 4.0))


@dataclass(frozen=True)
class TransmitPaths:
    """The outward paths, one per target point: where and how each ray meets the target, and what it travels.

    `direction` is the unit tangent there, `deflection` that by the flow, toward x and y [rad], `path` the optical path
    R_L from the exit aperture [m], `group_path` what a pulse travels [m], `trace` None in vacuum.
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
    """Return the peak power of each point's pulse at the receiver [W], shape (m,), for return factors (m,)."""
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
    source = field.upstream
    index = field.ambient_index if source is None or source.group is None else source.group.ambient_index
    return (index - 1.0) * distance


def air_error(field: IndexField, distance: float) -> float:
    """Return what the refractivity model's uncertainty makes of that excess [m]; NaN, not known, for raw contrast."""
    source = field.upstream
    if source is None:
        return math.nan
    share = source.refractivity if source.group is None else source.group.uncertainty
    return share * abs(still_air(field, distance))


@checked
def tilted_pulse_tau(pulse_tau: float, beam_radius: float, tilt: float) -> float:
    """1/e half-width [s] of the echo of a plane of any extent: the pulse's own, broadened by the tilted plane's depth.

    Args:
        pulse_tau: 1/e half-width of the pulse that leaves [s].
        beam_radius: 1/e^2 intensity radius of the beam at the target [m].
        tilt: Angle between the beam and the plane's normal [rad].

    Raises:
        ValueError: Lengths or times that are not positive, a tilt of a right angle or more.
    """
    spread = (
        math.sqrt(2.0) * check_positive(beam_radius, "beam_radius", "m") * math.tan(check_tilt(tilt)) / SPEED_OF_LIGHT
    )
    return math.hypot(check_positive(pulse_tau, "pulse_tau", "s"), spread)


def plane_echo_power(
    peak_power: float,
    receiver_diameter: float,
    distance,
    incidence_cosine,
    reflectance,
    atmospheric_transmission: float = 1.0,
    system_efficiency: float = 1.0,
):
    """Return the peak power [W] of the echo if the whole beam meets a surface at one distance and one incidence.

    P0 f_r cos(incidence) * (pi D^2 / 4) / R^2 * eta_a^2 eta_s: the reflector's radiance times the receiver's solid
    angle. `distance` [m], `incidence_cosine` and `reflectance` f_r [1/sr] may be arrays; nothing is checked here.
    """
    aperture = 0.25 * math.pi * receiver_diameter**2
    through = atmospheric_transmission**2 * system_efficiency
    return peak_power * reflectance * incidence_cosine * aperture / np.square(distance) * through


@checked
def plane_target_echo(
    time: Numbers,
    *,
    peak_power: float,
    receiver_diameter: float,
    beam_radius: float,
    distance: float,
    tilt: float = 0.0,
    pulse_tau: float,
    reflectivity: float,
    atmospheric_transmission: float = 1.0,
    system_efficiency: float = 1.0,
    strehl: float = 1.0,
    limits: str = "beam",
) -> np.ndarray:
    """Return the received power of the echo from a tilted plane without flow, eq 8 in closed form.

    P(t) = P0 D^2 eta_a^2 eta_s / (2 w^2 R^2) f_r cos(b) SR times the integral over x and y, normal to the beam, of
    exp(-2 (x^2 + y^2) / w^2) exp(-((t - 2 (R + y tan b) / c) / tau)^2), with f_r = reflectivity / pi. The light travels
    at c here.

    Args:
        time: Times after the pulse's peak left [s], any shape.
        peak_power: Peak power of the pulse that leaves [W].
        receiver_diameter: Diameter D of the receiver's pupil [m].
        beam_radius: 1/e^2 intensity radius of the parallel beam [m].
        distance: Distance R to the plane along the axis [m].
        tilt: Angle between the axis and the plane's normal, about x [rad].
        pulse_tau: 1/e half-width of the Gaussian pulse, FWHM / (2 sqrt(ln 2)) [s].
        reflectivity: Reflectivity at normal incidence, 0 to 1.
        atmospheric_transmission: Transmission one way, 0 to 1; the echo has its square.
        system_efficiency: Transmission of the optics, 0 to 1.
        strehl: Strehl ratio of the return path, 0 to 1, one for the whole target.
        limits: "beam", the whole beam; "paper", y limited to +-beam_radius, which loses 4.55 % untilted.

    Returns:
        Received power [W], of the shape of `time`.

    Raises:
        ValueError: A length, time or power that is not positive and finite, a fraction outside 0 to 1, a tilt of a
            right angle or more, unknown limits, times that are not finite.
        TypeError: An argument that is not a number.

    Examples:
        >>> import numpy as np
        >>> laser = {"peak_power": 75.0, "beam_radius": 30e-3, "pulse_tau": 6e-9}
        >>> place = {"receiver_diameter": 12e-3, "distance": 1.5, "reflectivity": 0.3}
        >>> power = plane_target_echo(np.arange(0.0, 40e-9, 1e-10), **laser, **place)
        >>> round(1e6 * power.max())  # microwatts
        360
    """
    from scipy.special import erf

    times = as_finite_array(time, "time")
    power = check_positive(peak_power, "peak_power", "W")
    diameter = check_positive(receiver_diameter, "receiver_diameter", "m")
    radius, reach = check_positive(beam_radius, "beam_radius", "m"), check_positive(distance, "distance", "m")
    angle, tau = check_tilt(tilt), check_positive(pulse_tau, "pulse_tau", "s")
    air = check_share(atmospheric_transmission, "atmospheric_transmission")
    optics = check_share(system_efficiency, "system_efficiency")
    ratio = check_share(strehl, "strehl")
    check_choice(limits, "limits", LIMITS)
    reflectance = check_share(reflectivity, "reflectivity") / math.pi
    peak = ratio * plane_echo_power(power, diameter, reach, math.cos(angle), reflectance, air, optics)
    late = times - 2.0 * reach / SPEED_OF_LIGHT
    spread = tilted_pulse_tau(tau, radius, angle)
    echo = peak * (tau / spread) * np.exp(-np.square(late / spread))
    if limits == "paper":  # y limited to +-h = radius, which untilted leaves erf(sqrt 2) = 0.9545
        slope = 2.0 * math.tan(angle) / (SPEED_OF_LIGHT * tau)
        sharpness = math.hypot(math.sqrt(2.0) / radius, slope)
        center = slope * late / (tau * sharpness**2)
        echo = echo * 0.5 * (erf(sharpness * (radius - center)) + erf(sharpness * (radius + center)))
    return np.asarray(echo)
