"""Plane flows whose density depends only on the direction from the origin: a wedge, an expansion fan.

The stream comes from +z. With the Prandtl-Meyer function nu, the angle between the Mach lines of the sonic stream and
of Mach number M is psi = nu + acos(1 / M), and T / T0 = 2 / (g + 1) cos^2(psi / sqrt(k)), k = (g + 1) / (g - 1).
References: NACA Report 1135 (1953), eq 171; Landau and Lifshitz, Fluid Mechanics, 2nd ed., paragraph 109.
"""

import math
from dataclasses import dataclass

import numpy as np

from aerokernels.flow.exact_field import MARGIN, DirectionFlow, ExactField, edges, square_step
from aerokernels.flow.gas import (
    GAMMA_AIR,
    GAS_CONSTANT_AIR,
    SEA_LEVEL_DENSITY,
    SEA_LEVEL_TEMPERATURE,
    check_gamma,
    free_stream,
    isentropic,
)
from aerokernels.flow.shocks import Shock, bisect, oblique_shock, prandtl_meyer
from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.inputs.checks import check_positive
from aerokernels.medium import Body


@dataclass(frozen=True)
class PlaneShock(DirectionFlow):
    """The two plane shocks of a wedge, mirrored at y = 0; `shock` is the state behind them, and their angle."""

    shock: Shock

    @checked
    def ratio_of_angle(self, angle: Numbers) -> np.ndarray:
        """Density over that of the free stream in a direction from the origin, an angle from -z towards +y [rad]."""
        angle = np.asarray(angle, dtype=np.float64)
        behind = np.abs(angle) < self.shock.shock_angle
        return np.where(np.isnan(angle), np.nan, np.where(behind, self.shock.density_ratio, 1.0))

    @property
    def breaks(self) -> tuple[float, float]:
        """Directions of the two shocks [rad]."""
        return self.shock.shock_angle, -self.shock.shock_angle


@checked
def wedge(
    mach: float,
    half_angle: float,
    *,
    strong: bool = False,
    density: float = SEA_LEVEL_DENSITY,
    temperature: float = SEA_LEVEL_TEMPERATURE,
    length: float = 0.1,
    height: float | None = None,
    spacing: float | None = None,
    gamma: float = GAMMA_AIR,
    gas_constant: float = GAS_CONSTANT_AIR,
) -> ExactField:
    """Return the exact flow over a symmetric wedge at zero incidence as a planar density field.

    The tip is at the origin; body and field end at z = -length. Cells inside the body have the density behind the
    shock. Averages over cells cut by a shock are exact to rounding.

    Args:
        mach: Mach number of the free stream.
        half_angle: Half angle of the wedge, by which each side turns the flow [rad].
        strong: Use the strong shock instead of the weak one, which a wedge in free flight has.
        density: Density of the free stream [kg/m3].
        temperature: Static temperature of the free stream [K]; affects only pressure and velocity in `conditions`.
        length: Length of the wedge [m].
        height: Height out to which the flow is given, to both sides of y = 0 [m]; None takes the shock's at the base
            and 8 cells.
        spacing: Greatest side of the square cells [m]; None takes 1/200 of the length.
        gamma: Ratio of specific heats.
        gas_constant: [J/(kg K)].

    Raises:
        ValueError: As for `oblique_shock`; a quantity that is not positive; a height below the shock's; a spacing that
            gives too few or too many cells.
    """
    check_positive(half_angle, "half_angle")
    shock = oblique_shock(mach, half_angle, strong=strong, gamma=gamma)
    step = square_step(length, spacing)
    least = length * math.tan(shock.shock_angle)
    reach = least + MARGIN * step if height is None else check_positive(height, "height")
    if reach < least:
        raise ValueError(f"height {reach:g} m cuts the flow: the shock reaches {least:g} m at the base of the wedge")
    base = length * math.tan(half_angle)
    words = f"a wedge of half angle {math.degrees(half_angle):.6g} deg at Mach {mach:g}"
    return PlaneShock(shock).field(
        edges(-reach, reach, step),
        edges(-length, MARGIN * step, step),
        free_stream(mach, density, temperature, gamma=gamma, gas_constant=gas_constant),
        Body(np.array([[0.0, 0.0], [base, -length], [-base, -length]]), "planar"),
        f"exact flow over {words} ({'strong' if strong else 'weak'} oblique shock)",
    )


@dataclass(frozen=True)
class ExpansionFan(DirectionFlow):
    """A centred expansion relative to the stream ahead of it. Angles are measured from that stream's direction.

    Attributes:
        mach: Mach number ahead.
        deflection: Angle by which the flow turns away [rad].
        downstream_mach: Mach number behind.
        density_ratio: rho2 / rho1.
        pressure_ratio: p2 / p1.
        temperature_ratio: T2 / T1.
        head_angle: Angle of the first Mach line [rad].
        tail_angle: Angle of the last Mach line [rad]; negative where that line points below the stream's direction.
        gamma: Ratio of specific heats.
    """

    mach: float
    deflection: float
    downstream_mach: float
    density_ratio: float
    pressure_ratio: float
    temperature_ratio: float
    head_angle: float
    tail_angle: float
    gamma: float

    @checked
    def ratio_of_angle(self, angle: Numbers) -> np.ndarray:
        """Density over that of the stream ahead; in the body that of the nearer wall. Angle from -z to +y [rad]."""
        angle = np.asarray(angle, dtype=np.float64)
        root = math.sqrt((self.gamma + 1.0) / (self.gamma - 1.0))
        first = math.atan(math.sqrt((self.mach - 1.0) * (self.mach + 1.0)) / root)
        turned = self.head_angle - np.clip(angle, self.tail_angle, self.head_angle)
        fan = (np.cos(first + turned / root) / math.cos(first)) ** (2.0 / (self.gamma - 1.0))
        # On either side of the fan the ratio is that of the uniform state, to the last bit.
        fan = np.where(angle <= self.tail_angle, self.density_ratio, fan)
        return np.where((angle < self.inner_angle) | (angle >= self.head_angle), 1.0, fan)

    @property
    def breaks(self) -> tuple[float, ...]:
        """Directions of the first and the last Mach line and of the plane that halves the body [rad]."""
        return self.head_angle, self.tail_angle, self.inner_angle

    @property
    def inner_angle(self) -> float:
        """Direction of the plane that halves the body, on either side of which the nearer wall's value holds [rad]."""
        return -0.5 * (self.deflection + math.pi)


@checked
def mach_after_turn(angle: float, *, gamma: float = GAMMA_AIR) -> float:
    """Return the Mach number to which a turn by `angle` [rad] expands a sonic stream: the inverse of `prandtl_meyer`.

    Raises:
        ValueError: A negative angle, or one at which the gas would reach vacuum (the message gives the greatest).
    """
    check_gamma(gamma)
    root = math.sqrt((gamma + 1.0) / (gamma - 1.0))
    greatest = 0.5 * math.pi * (root - 1.0)
    if not 0.0 <= angle < greatest:
        raise ValueError(
            f"angle {angle!r} rad has no Mach number: the Prandtl-Meyer angle is between 0 and {greatest:.6g} rad "
            f"({math.degrees(greatest):.4g} deg), where the gas reaches vacuum"
        )
    share = bisect(lambda u: root * u - math.atan(root * math.tan(u)) - angle, 0.0, 0.5 * math.pi)
    tangent = root * math.tan(share)
    return math.sqrt(1.0 + tangent**2)


@checked
def maximum_expansion(mach: float, *, gamma: float = GAMMA_AIR) -> float:
    """Return the angle [rad] by which a stream turns when it expands to vacuum."""
    root = math.sqrt((gamma + 1.0) / (gamma - 1.0)) if gamma > 1.0 else math.nan
    return 0.5 * math.pi * (root - 1.0) - prandtl_meyer(mach, gamma=gamma).angle


@checked
def expansion_fan(mach: float, deflection: float, *, gamma: float = GAMMA_AIR) -> ExpansionFan:
    """Return the state behind the Prandtl-Meyer fan of a convex corner.

    Args:
        mach: Mach number ahead, 1 or more.
        deflection: Angle by which the wall turns away from the stream [rad], zero or more.
        gamma: Ratio of specific heats.

    Raises:
        ValueError: A Mach number below 1, a negative deflection, or one at which the gas would reach vacuum (the
            message gives the greatest).
    """
    ahead = prandtl_meyer(mach, gamma=gamma)
    greatest = maximum_expansion(mach, gamma=gamma)
    if not (math.isfinite(deflection) and deflection >= 0.0):
        raise ValueError(f"deflection must be zero or positive, got {deflection!r}: a negative turn makes a shock")
    if deflection >= greatest:
        raise ValueError(
            f"the flow leaves the wall: deflection {deflection:.6g} rad ({math.degrees(deflection):.4g} deg) is above "
            f"{greatest:.6g} rad ({math.degrees(greatest):.4g} deg), where the gas of Mach {mach:g} reaches vacuum"
        )
    downstream = mach_after_turn(ahead.angle + deflection, gamma=gamma) if deflection > 0.0 else float(mach)
    before, after = isentropic(mach, gamma=gamma), isentropic(downstream, gamma=gamma)
    return ExpansionFan(
        mach=float(mach),
        deflection=float(deflection),
        downstream_mach=downstream,
        density_ratio=after.density_ratio / before.density_ratio,
        pressure_ratio=after.pressure_ratio / before.pressure_ratio,
        temperature_ratio=after.temperature_ratio / before.temperature_ratio,
        head_angle=ahead.mach_angle,
        tail_angle=math.asin(1.0 / downstream) - deflection,
        gamma=float(gamma),
    )


@checked
def expansion(
    mach: float,
    deflection: float,
    *,
    density: float = SEA_LEVEL_DENSITY,
    temperature: float = SEA_LEVEL_TEMPERATURE,
    length: float = 0.1,
    height: float | None = None,
    spacing: float | None = None,
    gamma: float = GAMMA_AIR,
    gas_constant: float = GAS_CONSTANT_AIR,
) -> ExactField:
    """Return the exact flow around a convex corner as a planar density field.

    The stream comes from +z along a wall at y = 0. At the corner, the origin, the wall turns away towards -y. The field
    extends from z = length / 2 to -length. Cell averages are exact to rounding, also at the corner.

    Args:
        mach: Mach number of the stream ahead, 1 or more.
        deflection: Angle by which the wall turns away [rad], below 90 degrees.
        density: Density of the stream ahead [kg/m3].
        temperature: Its static temperature [K]; affects only pressure and velocity in `conditions`.
        length: Length of the wall behind the corner, along z [m].
        height: Height above y = 0 out to which the flow is given [m]; None takes the first Mach line's at the end of
            the field, but at most `length`, and 8 cells.
        spacing: Greatest side of the square cells [m]; None takes 1/200 of the length.
        gamma: Ratio of specific heats.
        gas_constant: [J/(kg K)].

    Raises:
        ValueError: As for `expansion_fan` or `wedge`; a turn of 90 degrees or more.
    """
    fan = expansion_fan(mach, deflection, gamma=gamma)
    if deflection >= 0.5 * math.pi:
        raise ValueError(f"deflection {deflection:g} rad turns the wall back against the stream: take less than pi/2")
    step = square_step(length, spacing)
    if height is None:
        tall = min(length, length * math.tan(fan.head_angle)) + MARGIN * step
    else:
        tall = check_positive(height, "height")
    foot = -length * math.tan(deflection)
    depth = foot - MARGIN * step
    ahead = 0.5 * length
    y, z = edges(depth, tall, step), edges(-length, ahead, step)
    low, front = float(y[0]), float(z[-1])
    outline = np.array([[0.0, front], [0.0, 0.0], [foot, -length], [low, -length], [low, front]])
    return fan.field(
        y,
        z,
        free_stream(mach, density, temperature, gamma=gamma, gas_constant=gas_constant),
        Body(outline, "planar"),
        f"exact flow around a corner of {math.degrees(deflection):.6g} deg at Mach {mach:g} (Prandtl-Meyer)",
    )
