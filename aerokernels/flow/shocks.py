"""Shock waves and expansions of a perfect gas in closed form.

Reference: NACA Report 1135 (1953), eq 92-98, 138, 168, 171c. Air: g = 1.4.
"""

import math
from dataclasses import dataclass

from aerokernels.flow.gas import GAMMA_AIR, check_gamma, stagnation_ratio
from aerokernels.inputs.arguments import checked
from aerokernels.inputs.checks import remedy_of_angle


@dataclass(frozen=True)
class Shock:
    """The state behind a straight shock relative to the state ahead of it.

    Attributes:
        mach: Mach number ahead of the shock.
        deflection: Angle by which the flow turns [rad].
        shock_angle: Angle between the shock and the flow ahead of it [rad]; pi/2 for a normal shock.
        density_ratio: rho2 / rho1.
        pressure_ratio: p2 / p1.
        temperature_ratio: T2 / T1.
        stagnation_pressure_ratio: p02 / p01.
        downstream_mach: Mach number behind the shock.
    """

    mach: float
    deflection: float
    shock_angle: float
    density_ratio: float
    pressure_ratio: float
    temperature_ratio: float
    stagnation_pressure_ratio: float
    downstream_mach: float


@dataclass(frozen=True)
class PrandtlMeyer:
    """The Prandtl-Meyer angle of a supersonic stream.

    Attributes:
        mach: Mach number.
        angle: Turn that expands a sonic stream to this Mach number [rad].
        mach_angle: Angle between a Mach line and the flow [rad].
    """

    mach: float
    angle: float
    mach_angle: float


@checked
def normal_shock(mach: float, *, gamma: float = GAMMA_AIR) -> Shock:
    """Return the state behind a shock normal to the flow.

    Raises:
        ValueError: A Mach number below 1 or not finite, or gamma not above 1.
    """
    check_supersonic(mach, gamma)
    return _behind(mach, 0.5 * math.pi, 0.0, gamma)


@checked
def oblique_shock(mach: float, deflection: float, *, strong: bool = False, gamma: float = GAMMA_AIR) -> Shock:
    """Return the state behind the attached oblique shock of a wedge.

    Args:
        mach: Mach number ahead of the shock.
        deflection: Angle by which the flow turns [rad], zero or more.
        strong: Return the strong solution instead of the weak one, which a wedge in free flight has.
        gamma: Ratio of specific heats.

    Raises:
        ValueError: A Mach number below 1, a negative deflection, or a deflection so large that the shock detaches (the
            message gives the greatest).

    Examples:
        >>> import math
        >>> shock = oblique_shock(3.0, math.radians(15.0))
        >>> round(math.degrees(shock.shock_angle), 2), round(shock.density_ratio, 3)
        (32.24, 2.032)
    """
    check_supersonic(mach, gamma)
    if not (math.isfinite(deflection) and deflection >= 0.0):
        raise ValueError(f"deflection must be zero or positive, got {deflection!r}: a negative turn expands the flow")
    summit = _angle_of_maximum_deflection(mach, gamma)
    greatest = _deflection(mach, summit, gamma)
    if deflection > greatest:
        raise ValueError(
            f"the shock detaches: deflection {deflection:.6g} rad ({math.degrees(deflection):.4g} deg) is above the "
            f"greatest that Mach {mach:g} allows, {greatest:.6g} rad ({math.degrees(greatest):.4g} deg): "
            f"{remedy_of_angle(deflection)}"
        )
    flat = 0.5 * math.pi if strong else math.asin(1.0 / mach)
    # The deflection rises from zero at the Mach angle to the summit and falls to zero at the normal shock.
    angle = flat if deflection == 0.0 else bisect(lambda b: _deflection(mach, b, gamma) - deflection, flat, summit)
    return _behind(mach, angle, deflection, gamma)


@checked
def maximum_deflection(mach: float, *, gamma: float = GAMMA_AIR) -> float:
    """Return the greatest deflection [rad] at which the shock of a wedge is attached."""
    check_supersonic(mach, gamma)
    return _deflection(mach, _angle_of_maximum_deflection(mach, gamma), gamma)


@checked
def prandtl_meyer(mach: float, *, gamma: float = GAMMA_AIR) -> PrandtlMeyer:
    """Return the Prandtl-Meyer angle and the Mach angle of a stream.

    Raises:
        ValueError: A Mach number below 1 or not finite, or gamma not above 1.
    """
    check_supersonic(mach, gamma)
    root = math.sqrt(mach**2 - 1.0)
    stretch = math.sqrt((gamma + 1.0) / (gamma - 1.0))
    return PrandtlMeyer(float(mach), stretch * math.atan(root / stretch) - math.atan(root), math.asin(1.0 / mach))


def density_jump(normal_mach_square, gamma: float):
    """Return rho2 / rho1 across a shock from the square of the Mach number normal to it, a number or an array."""
    return (gamma + 1.0) * normal_mach_square / ((gamma - 1.0) * normal_mach_square + 2.0)


def _behind(mach: float, angle: float, deflection: float, gamma: float) -> Shock:
    square = max((mach * math.sin(angle)) ** 2, 1.0)
    density = density_jump(square, gamma)
    pressure = 1.0 + 2.0 * gamma / (gamma + 1.0) * (square - 1.0)
    temperature = pressure / density
    # The velocity along the shock is unchanged, the normal one is divided by the density ratio; sound speed^2 ~ T.
    velocity_square = (mach * math.cos(angle)) ** 2 + square / density**2
    stagnation = stagnation_ratio(density, pressure, gamma)
    return Shock(
        mach=float(mach),
        deflection=float(deflection),
        shock_angle=float(angle),
        density_ratio=density,
        pressure_ratio=pressure,
        temperature_ratio=temperature,
        stagnation_pressure_ratio=stagnation,
        downstream_mach=math.sqrt(velocity_square / temperature),
    )


def _deflection(mach: float, angle: float, gamma: float) -> float:
    excess = max((mach * math.sin(angle)) ** 2 - 1.0, 0.0)
    return math.atan2(2.0 * excess, math.tan(angle) * (mach**2 * (gamma + math.cos(2.0 * angle)) + 2.0))


def _angle_of_maximum_deflection(mach: float, gamma: float) -> float:
    square = mach**2
    inner = (gamma + 1.0) * ((gamma + 1.0) * square**2 / 16.0 + 0.5 * (gamma - 1.0) * square + 1.0)
    sine_square = (0.25 * (gamma + 1.0) * square - 1.0 + math.sqrt(inner)) / (gamma * square)
    return math.asin(math.sqrt(min(sine_square, 1.0)))


def bisect(function, low: float, high: float) -> float:
    """Return the root of a function, negative at `low` and not negative at `high`, to the last bit."""
    while True:
        middle = 0.5 * (low + high)
        if middle in (low, high):
            return middle
        if function(middle) < 0.0:
            low = middle
        else:
            high = middle


def check_supersonic(mach: float, gamma: float) -> None:
    """Raise ValueError for a Mach number below 1, or a ratio of specific heats that is not above 1."""
    if not (math.isfinite(mach) and mach >= 1.0):
        raise ValueError(f"mach must be 1 or more for a shock or an expansion, got {mach!r}")
    check_gamma(gamma)
