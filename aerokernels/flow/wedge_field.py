"""Plane shocks as density fields: the flow over a wedge, and one shock across a stream.

In the optical frame the stream comes from +z and flows towards -z. The density depends only on the direction from the
origin.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..inputs.arguments import Numbers, checked
from ..inputs.checks import check_positive
from ..medium import Body
from .exact_field import MARGIN, DirectionFlow, ExactField, edges, square_step
from .gas import GAMMA_AIR, GAS_CONSTANT_AIR, SEA_LEVEL_DENSITY, SEA_LEVEL_TEMPERATURE, free_stream
from .shocks import Shock, normal_shock, oblique_shock


@dataclass(frozen=True)
class PlaneShock(DirectionFlow):
    """One plane shock through the origin, or the two shocks of a wedge, mirrored at y = 0.

    Attributes:
        shock: State behind the shock, and its angle.
        mirrored: Whether there are two shocks, as over a wedge.
    """

    shock: Shock
    mirrored: bool

    @checked
    def ratio_of_angle(self, angle: Numbers) -> np.ndarray:
        """Density over that of the free stream in a direction from the origin, an angle from -z towards +y [rad]."""
        angle = np.asarray(angle, dtype=np.float64)
        if self.mirrored:
            behind = np.abs(angle) < self.shock.shock_angle
        else:
            behind = np.sin(self.shock.shock_angle - angle) > 0.0
        return np.where(np.isnan(angle), np.nan, np.where(behind, self.shock.density_ratio, 1.0))

    @property
    def breaks(self) -> tuple[float, float]:
        """Directions of the shock's two halves [rad]."""
        angle = self.shock.shock_angle
        return (angle, -angle) if self.mirrored else (angle, angle - math.pi)


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

    The tip is at the origin; body and field end at z = -length. Behind either shock the density is uniform, and cells
    inside the body have that density too, so that an interpolant has no error at the wall. The average over a cell cut
    by a shock is exact to rounding: integrals over whole cells are exact.

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

    Returns:
        The field; `solution.shock` has the oblique shock's relations.

    Raises:
        ValueError: As for `oblique_shock` (if the shock detaches, the message gives the greatest angle); a quantity
            that is not positive; a height below the shock's; a spacing that gives too few or too many cells.
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
    return PlaneShock(shock, mirrored=True).field(
        edges(-reach, reach, step),
        edges(-length, MARGIN * step, step),
        free_stream(mach, density, temperature, gamma=gamma, gas_constant=gas_constant),
        Body(np.array([[0.0, 0.0], [base, -length], [-base, -length]]), "planar"),
        f"exact flow over {words} ({'strong' if strong else 'weak'} oblique shock)",
    )


@checked
def plane_shock(
    mach: float,
    deflection: float | None = None,
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
    """Return one plane shock across a stream, through the origin, as a planar density field without a body.

    The field is a box about the origin. Outside the box the index is that of the free stream, even downstream of the
    shock, so rays should end inside the box.

    Args:
        mach: Mach number of the free stream.
        deflection: Angle by which the shock turns the flow [rad]; None for a normal shock.
        strong: Use the strong one of the two solutions of an oblique shock.
        density: Density of the free stream [kg/m3].
        temperature: Static temperature of the free stream [K]; affects only pressure and velocity in `conditions`.
        length: Extent of the box along z [m].
        height: Extent of the box along y [m]; None takes `length`.
        spacing: Greatest side of the square cells [m]; None takes 1/200 of the length.
        gamma: Ratio of specific heats.
        gas_constant: [J/(kg K)].

    Raises:
        ValueError: As for `normal_shock` or `oblique_shock`; a quantity that is not positive; a spacing that gives too
            few or too many cells.
    """
    if deflection is None:
        shock, words = normal_shock(mach, gamma=gamma), "normal shock"
    else:
        shock = oblique_shock(mach, deflection, strong=strong, gamma=gamma)
        words = f"{'strong' if strong else 'weak'} oblique shock with a turn of {math.degrees(deflection):.6g} deg"
    step = square_step(length, spacing)
    tall = length if height is None else check_positive(height, "height")
    return PlaneShock(shock, mirrored=False).field(
        edges(-0.5 * tall, 0.5 * tall, step),
        edges(-0.5 * length, 0.5 * length, step),
        free_stream(mach, density, temperature, gamma=gamma, gas_constant=gas_constant),
        None,
        f"exact {words} at Mach {mach:g}",
    )
