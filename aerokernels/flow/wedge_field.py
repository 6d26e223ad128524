"""Plane shocks as density fields: the flow over a wedge, and a shock that stands across a stream.

Optical frame: the stream comes from +z and runs towards -z. The density depends on the direction from the origin alone.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..inputs.arguments import checked
from ..inputs.checks import check_positive
from ..medium import Body
from .exact_averages import direction_averages
from .exact_field import MARGIN, ExactField, edges, rectangles, square_step
from .gas import GAMMA_AIR, GAS_CONSTANT_AIR, SEA_LEVEL_DENSITY, SEA_LEVEL_TEMPERATURE, free_stream
from .shocks import Shock, normal_shock, oblique_shock


@dataclass(frozen=True)
class PlaneShock:
    """One plane shock through the origin, or the two of a wedge, mirrored at y = 0.

    Attributes:
        shock: State behind the shock, and its angle.
        mirrored: Whether there are two, as over a wedge.
    """

    shock: Shock
    mirrored: bool

    def density_ratio_at(self, y, z) -> np.ndarray:
        """Density over that of the free stream at (y, z) [m]."""
        return self.ratio_of_angle(np.arctan2(y, -np.asarray(z)))

    def ratio_of_angle(self, angle) -> np.ndarray:
        """Density over that of the free stream in a direction: angle from -z towards +y [rad]."""
        if self.mirrored:
            behind = np.abs(angle) < self.shock.shock_angle
        else:
            behind = np.sin(self.shock.shock_angle - angle) > 0.0
        return np.where(behind, self.shock.density_ratio, 1.0)

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
    """The exact flow over a symmetric wedge at zero incidence, as a planar density field.

    The tip is at the origin, the body reaches to z = -length, and the field ends there. Behind either shock the density
    is uniform; the cells within the body carry it on, so that nothing is polluted at the wall. A cell that the shock
    cuts holds the exact average, to rounding: line integrals over whole cells are exact.

    Args:
        mach: Mach number of the free stream.
        half_angle: Half angle of the wedge, by which each side turns the flow [rad].
        strong: Take the strong shock in place of the weak one, which is what a wedge in free flight shows.
        density: Density of the free stream [kg/m3].
        temperature: Static temperature of the free stream [K]; it sets pressure and velocity in `conditions` alone.
        length: Length of the wedge [m].
        height: Height out to which the flow is given, to both sides of y = 0 [m]; None takes the shock's at the base
            and 8 cells.
        spacing: Greatest width of the cells, square ones [m]; None takes 1/200 of the length.
        gamma: Ratio of specific heats.
        gas_constant: [J/(kg K)].

    Returns:
        The field; `solution.shock` has the oblique shock's relations.

    Raises:
        ValueError: What oblique_shock refuses (a shock that detaches: the message gives the greatest angle), a quantity
            that is not positive, a height within the shock, or a spacing for too few or too many cells.
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
    return _field(
        PlaneShock(shock, mirrored=True),
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
    """One plane shock across a stream, through the origin, as a planar density field without a body.

    The field is a box about the origin. Outside it the index is the free stream's, also where the gas behind the shock
    goes on: let rays end inside.

    Args:
        mach: Mach number of the free stream.
        deflection: Angle by which the shock turns the flow [rad]; None for a normal shock.
        strong: Take the strong solution of the two that an oblique shock has.
        density: Density of the free stream [kg/m3].
        temperature: Static temperature of the free stream [K]; it sets pressure and velocity in `conditions` alone.
        length: Extent of the box along z [m].
        height: Extent along y [m]; None takes `length`.
        spacing: Greatest width of the cells, square ones [m]; None takes 1/200 of the length.
        gamma: Ratio of specific heats.
        gas_constant: [J/(kg K)].

    Raises:
        ValueError: What normal_shock or oblique_shock refuses, a quantity that is not positive, or a spacing for too
            few or too many cells.
    """
    if deflection is None:
        shock, words = normal_shock(mach, gamma=gamma), "normal shock"
    else:
        shock = oblique_shock(mach, deflection, strong=strong, gamma=gamma)
        words = f"{'strong' if strong else 'weak'} oblique shock with a turn of {math.degrees(deflection):.6g} deg"
    step = square_step(length, spacing)
    tall = length if height is None else check_positive(height, "height")
    return _field(
        PlaneShock(shock, mirrored=False),
        edges(-0.5 * tall, 0.5 * tall, step),
        edges(-0.5 * length, 0.5 * length, step),
        free_stream(mach, density, temperature, gamma=gamma, gas_constant=gas_constant),
        None,
        f"exact {words} at Mach {mach:g}",
    )


def _field(solution: PlaneShock, y, z, stream, body, words: str) -> ExactField:
    mesh = rectangles(y, z)
    ratio = direction_averages(solution.ratio_of_angle, solution.breaks, y, z)
    return ExactField(mesh, stream.density * ratio, stream.density, body, stream, words, solution)
