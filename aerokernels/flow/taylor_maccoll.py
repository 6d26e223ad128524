"""Supersonic flow over a circular cone at zero incidence: the Taylor-Maccoll solution.

The variables integrated from shock to wall are the deviations from the free stream, u = v_r - cos t and w = v_t + sin
t, and the unknown is the shock's strength e = M^2 sin^2 b - 1: no step subtracts nearly equal numbers, so slender cones
are as accurate as blunt ones. References: G. I. Taylor and J. W. Maccoll, Proc. R. Soc. A 139 (1933) 278; J. D.
Anderson, Modern Compressible Flow, 3rd ed., ch. 10. Tables: J. L. Sims, NASA SP-3004 (1964).
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from aerokernels.flow.gas import GAMMA_AIR, stagnation_ratio
from aerokernels.flow.shocks import Shock, check_supersonic, density_jump, maximum_deflection, oblique_shock
from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.inputs.checks import remedy_of_angle

# Below this half angle the shock's strength is less than 1e-24 and the flow is the free stream to double precision.
LEAST_HALF_ANGLE = 1e-6
TOLERANCE = 1e-13
# Profile entries per step of the integrator: the cubics between entries are then accurate to 1e-12.
PARTS = 16


@dataclass(frozen=True)
class ConeShock(Shock):
    """The flow over a cone, relative to the free stream; see `Shock` for the state just behind the shock.

    Attributes:
        half_angle: Half angle of the cone [rad].
        surface_mach: Mach number at the wall.
        surface_density_ratio: Density at the wall over that of the free stream.
        surface_pressure_ratio: Pressure at the wall over that of the free stream.
        surface_temperature_ratio: Temperature at the wall over that of the free stream.
        gamma: Ratio of specific heats.
        profile: SciPy's spline of u = v_r - cos t and w = v_t + sin t, over the free stream's speed, in the angle below
            the shock s = shock_angle - t [rad], t the polar angle.
    """

    half_angle: float
    surface_mach: float
    surface_density_ratio: float
    surface_pressure_ratio: float
    surface_temperature_ratio: float
    gamma: float
    profile: Any = field(repr=False, compare=False)

    @checked
    def density_ratio_at(self, polar_angle: Numbers) -> np.ndarray:
        """Return density over that of the free stream at polar angles [rad]; inside the body the value at the wall."""
        angle = np.asarray(polar_angle, dtype=np.float64)
        ahead = angle > self.shock_angle  # NaN is not, and stays NaN
        u, w = self._deviation(angle)
        excess = temperature_excess(self.mach, self.gamma, np.clip(angle, self.half_angle, self.shock_angle), u, w)
        ratio = self.stagnation_pressure_ratio * (1.0 + excess) ** (1.0 / (self.gamma - 1.0))
        return np.where(ahead, 1.0, ratio)

    @checked
    def velocity_at(self, polar_angle: Numbers) -> tuple[np.ndarray, np.ndarray]:
        """Return the radial and polar velocity about the tip, over the free stream's speed, at polar angles [rad].

        The polar velocity is positive toward greater angles. Inside the body both have their values at the wall.
        """
        angle = np.asarray(polar_angle, dtype=np.float64)
        ahead = angle > self.shock_angle
        outside = np.maximum(angle, self.half_angle)
        u, w = self._deviation(angle)
        return np.cos(outside) + np.where(ahead, 0.0, u), np.where(ahead, 0.0, w) - np.sin(outside)

    def _deviation(self, angle: np.ndarray) -> np.ndarray:
        """Return (u, w), shape (2, ...), at polar angles [rad], those outside moved to the shock or to the wall."""
        return np.moveaxis(self.profile(np.clip(self.shock_angle - angle, 0.0, self.profile.x[-1])), -1, 0)


def temperature_excess(mach, gamma, angle, u, w):
    """Return T / T1 - 1 at a polar angle [rad] from the deviation (u, w), by conservation of total enthalpy."""
    square = u * (2.0 * np.cos(angle) + u) + w * (w - 2.0 * np.sin(angle))
    return -0.5 * (gamma - 1.0) * mach**2 * square


@checked
def cone_shock(mach: float, half_angle: float, *, gamma: float = GAMMA_AIR) -> ConeShock:
    """Return the flow over a cone at zero incidence with an attached shock: the weak solution, that of free flight.

    Angles and ratios are accurate to 1e-11. As the half angle goes to zero the shock becomes a Mach wave.

    Args:
        mach: Mach number of the free stream, above 1.
        half_angle: Half angle of the cone [rad], at least 1e-6.
        gamma: Ratio of specific heats.

    Raises:
        ValueError: A Mach number below 1, a half angle that is not positive, or one so large that the shock detaches
            (the message gives the greatest).

    Examples:
        >>> import math
        >>> round(math.degrees(cone_shock(3.0, math.radians(15.0)).shock_angle), 2)
        25.26
    """
    check_supersonic(mach, gamma)
    if not (math.isfinite(half_angle) and half_angle >= LEAST_HALF_ANGLE):
        raise ValueError(f"half_angle must be at least {LEAST_HALF_ANGLE:g} rad, got {half_angle!r}: give radians")
    strength = _strength(float(mach), float(half_angle), float(gamma))
    return _assemble(float(mach), float(half_angle), float(gamma), strength)


@checked
def maximum_cone_angle(mach: float, *, gamma: float = GAMMA_AIR) -> float:
    """Return the greatest half angle [rad] of a cone at which the shock is attached."""
    check_supersonic(mach, gamma)
    return _summit(float(mach), float(gamma))[1]


def _strength(mach: float, half_angle: float, gamma: float) -> float:
    """Return the shock's strength e = M^2 sin^2 b - 1 for a half angle [rad]."""
    from scipy.optimize import brentq

    # Where the shock of a wedge of the same angle is attached, it is stronger and gives an upper bound.
    if half_angle < maximum_deflection(mach, gamma=gamma):
        angle = oblique_shock(mach, half_angle, gamma=gamma).shock_angle
        high = (mach * math.sin(angle)) ** 2 - 1.0
    else:
        high, greatest = _summit(mach, gamma)
        if half_angle > greatest:
            raise ValueError(
                f"the shock detaches: half angle {half_angle:.6g} rad ({math.degrees(half_angle):.4g} deg) is above "
                f"the greatest that Mach {mach:g} allows, {greatest:.6g} rad ({math.degrees(greatest):.4g} deg): "
                f"{remedy_of_angle(half_angle)}"
            )

    def excess(logarithm: float) -> float:
        return _wall_angle(mach, math.exp(logarithm), gamma, half_angle) - half_angle

    top = bottom = math.log(high)
    over = excess(top)
    if over <= 0.0:
        return high  # the greatest half angle itself
    while over > 0.0:
        # The half angle grows with the fourth root of the strength for slender cones, faster for blunt ones.
        top, bottom = bottom, bottom - 4.0 * math.log1p(over / half_angle) - 0.5
        over = excess(bottom)
    return math.exp(brentq(excess, bottom, top, xtol=1e-12, rtol=1e-13))


def _summit(mach: float, gamma: float) -> tuple[float, float]:
    """Return the greatest half angle's shock strength, and that half angle [rad]."""
    from scipy.optimize import minimize_scalar

    greatest = (mach - 1.0) * (mach + 1.0)
    if greatest <= 0.0:
        return 0.0, 0.0
    low = math.asin(1.0 / mach)

    def strength(angle: float) -> float:
        # sin^2 b - sin^2 m as a product, with the Mach angle m = `low`: no cancellation near the Mach angle.
        return mach**2 * math.sin(angle + low) * math.sin(angle - low)

    result = minimize_scalar(
        lambda angle: -_wall_angle(mach, strength(angle), gamma, 0.0),
        bounds=(low, 0.5 * math.pi),
        method="bounded",
        options={"xatol": 1e-7},
    )
    return strength(result.x), -float(result.fun)


def _shock_angle(mach: float, strength: float) -> float:
    return math.atan2(math.sqrt(1.0 + strength), math.sqrt(max((mach - 1.0) * (mach + 1.0) - strength, 0.0)))


def _integrate(mach: float, strength: float, gamma: float, end: float, *, wall: bool, dense: bool = False):
    """Integrate u and w from the shock to the polar angle `end` [rad] or, with `wall`, to where the flow is radial."""
    from scipy.integrate import solve_ivp

    shock_angle = _shock_angle(mach, strength)
    sine_square = (1.0 + strength) / mach**2
    half = 0.5 * (gamma - 1.0)
    sine, cosine = math.sin(shock_angle), math.cos(shock_angle)

    def slope(s, state):
        u, w = state
        sin_s, cos_s = math.sin(s), math.cos(s)
        sin_t, cos_t = sine * cos_s - cosine * sin_s, cosine * cos_s + sine * sin_s
        square = u * (2.0 * cos_t + u) + w * (w - 2.0 * sin_t)
        sound_square = 1.0 / mach**2 - half * square
        # 1 / M^2 - sin^2 t as a product, because the two terms are almost equal near the shock.
        uniform = (sine * cos_t + cosine * sin_t) * sin_s - strength / mach**2
        gap = uniform - half * square + w * (2.0 * sin_t - w)
        return -w, u + sound_square * (u + w * cos_t / sin_t) / gap

    def radial(s, state):
        return state[1] - math.sin(shock_angle - s)

    radial.terminal = True  # type: ignore[attr-defined]
    start = 2.0 * strength / ((gamma + 1.0) * (1.0 + strength)) * math.sqrt(sine_square)
    solution = solve_ivp(
        slope,
        (0.0, max(shock_angle - end, 0.0)),
        (0.0, start),
        method="DOP853",
        rtol=TOLERANCE,
        atol=TOLERANCE * 1e-3 * start,
        events=radial if wall else None,
        dense_output=dense,
    )
    if not solution.success:
        raise ValueError(f"no conical flow at Mach {mach:g}, gamma {gamma:g}: {solution.message}")
    return shock_angle, solution, slope


def _wall_angle(mach: float, strength: float, gamma: float, floor: float) -> float:
    """Return the half angle of the cone behind a shock of given strength [rad].

    If it is below `floor`, the integration ends at `floor` and is continued by a tangent: at the wall v_t' = -2 v_r.
    """
    if strength <= 0.0:
        return 0.0
    # The end must be off the axis, where cot t is infinite, and not above the shock, which may be below `floor`.
    floor = min(max(floor, 1e-9), _shock_angle(mach, strength))
    shock_angle, solution, _ = _integrate(mach, strength, gamma, floor, wall=True)
    if solution.t_events[0].size:
        return shock_angle - float(solution.t_events[0][0])
    u, w = solution.y[:, -1]
    return floor + (w - math.sin(floor)) / (2.0 * (math.cos(floor) + u))


def _assemble(mach: float, half_angle: float, gamma: float, strength: float) -> ConeShock:
    from scipy.interpolate import CubicHermiteSpline

    shock_angle, solution, slope = _integrate(mach, strength, gamma, half_angle, wall=False, dense=True)
    steps = solution.t
    depth = np.append((steps[:-1, None] + np.diff(steps)[:, None] * np.arange(PARTS) / PARTS).ravel(), steps[-1])
    radial, polar = solution.sol(depth)
    polar_slope = np.array(
        [slope(s, state)[1] for s, state in zip(depth, zip(radial, polar, strict=True), strict=True)]
    )
    # du / ds = -w: the flow has no vorticity.
    profile = CubicHermiteSpline(depth, np.stack([radial, polar], axis=1), np.stack([-polar, polar_slope], axis=1))
    density = density_jump(1.0 + strength, gamma)
    pressure = 1.0 + 2.0 * gamma / (gamma + 1.0) * strength
    stagnation = stagnation_ratio(density, pressure, gamma)
    (temperature, speed), (wall_temperature, wall_speed) = (
        (
            1.0 + float(temperature_excess(mach, gamma, angle, u, w)),
            math.hypot(math.cos(angle) + u, w - math.sin(angle)),
        )
        for angle, u, w in ((shock_angle, radial[0], polar[0]), (half_angle, radial[-1], polar[-1]))
    )
    return ConeShock(
        mach=mach,
        half_angle=half_angle,
        shock_angle=shock_angle,
        deflection=math.atan2(polar[0] * math.cos(shock_angle), 1.0 - polar[0] * math.sin(shock_angle)),
        density_ratio=density,
        pressure_ratio=pressure,
        temperature_ratio=pressure / density,
        stagnation_pressure_ratio=stagnation,
        downstream_mach=mach * speed / math.sqrt(temperature),
        surface_mach=mach * wall_speed / math.sqrt(wall_temperature),
        surface_density_ratio=stagnation * wall_temperature ** (1.0 / (gamma - 1.0)),
        surface_pressure_ratio=stagnation * wall_temperature ** (gamma / (gamma - 1.0)),
        surface_temperature_ratio=wall_temperature,
        gamma=gamma,
        profile=profile,
    )
