"""The isentropic vortex: a steady swirl of uniform entropy, with its density in closed form.

v(r) = a M (r / R) exp((1 - r^2 / R^2) / 2), with the sound speed a far away and its maximum M a at R, satisfies the
Euler equations. Reference: C.-W. Shu, LNM 1697 (1998), where its strength is epsilon = 2 pi M sqrt(g).
"""

import math
from dataclasses import dataclass

import numpy as np

from aerokernels.flow.exact_field import ExactField, edges, rectangles, smooth_averages
from aerokernels.flow.gas import GAMMA_AIR, SEA_LEVEL_DENSITY, check_density, check_gamma
from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.inputs.checks import check_positive

# Half width of the field in radii: at its faces the temperature deviation is 1e-15 of that in the middle.
REACH = 6.0


@dataclass(frozen=True)
class Vortex:
    """An isentropic vortex about the line x = 0, y = 0, z = 0 of the optical frame.

    Attributes:
        mach: Greatest speed of the swirl over the sound speed far away.
        radius: Radius at which the swirl is fastest [m].
        gamma: Ratio of specific heats.
    """

    mach: float
    radius: float
    gamma: float = GAMMA_AIR

    def __post_init__(self):
        """Check the numbers."""
        check_positive(self.mach, "mach")
        check_positive(self.radius, "radius")
        check_gamma(self.gamma)
        greatest = math.sqrt(2.0 / ((self.gamma - 1.0) * math.e))
        if self.mach >= greatest:
            raise ValueError(
                f"mach {self.mach:g} is too great for a vortex: it must be below {greatest:.6g}, where the gas in the "
                f"middle reaches vacuum (gamma {self.gamma:g})"
            )

    @checked
    def temperature_ratio_at(self, distance: Numbers) -> np.ndarray:
        """Temperature over that far away at distances from the middle [m]."""
        square = (np.asarray(distance, dtype=np.float64) / self.radius) ** 2
        return 1.0 - 0.5 * (self.gamma - 1.0) * self.mach**2 * np.exp(1.0 - square)

    @checked
    def pressure_ratio_at(self, distance: Numbers) -> np.ndarray:
        """Pressure over that far away at distances from the middle [m]."""
        return self.temperature_ratio_at(distance) ** (self.gamma / (self.gamma - 1.0))

    @checked
    def mach_at(self, distance: Numbers) -> np.ndarray:
        """Speed of the swirl over the sound speed far away, at distances from the middle [m]."""
        share = np.asarray(distance, dtype=np.float64) / self.radius
        return self.mach * share * np.exp(0.5 * (1.0 - share**2))

    @checked
    def density_ratio_at(self, y: Numbers, z: Numbers) -> np.ndarray:
        """Density over that far away at (y, z) [m]."""
        return self.temperature_ratio_at(np.hypot(y, z)) ** (1.0 / (self.gamma - 1.0))


@checked
def vortex(
    mach: float,
    *,
    radius: float = 0.01,
    density: float = SEA_LEVEL_DENSITY,
    spacing: float | None = None,
    gamma: float = GAMMA_AIR,
) -> ExactField:
    """Return the isentropic vortex as a planar density field, with its axis along x through the origin.

    The field extends six radii to each side, where the density equals the ambient one to rounding. Cell averages by
    Gauss's rule are accurate to 1e-11 for cells up to half a radius.

    Args:
        mach: Greatest speed of the swirl over the sound speed far away; below 1.356 in air.
        radius: Radius at which the swirl is fastest [m].
        density: Density far away [kg/m3].
        spacing: Greatest side of the square cells [m]; None takes 1/40 of the radius.
        gamma: Ratio of specific heats.

    Raises:
        ValueError: A quantity that is not positive, a Mach number at which the middle reaches vacuum, gamma not above
            1, or a spacing that exceeds half a radius or gives too many cells.
    """
    swirl = Vortex(float(mach), float(radius), float(gamma))
    check_density(density, "density")
    step = radius / 40 if spacing is None else check_positive(spacing, "spacing")
    if step > 0.5 * radius * (1.0 + 1e-9):
        raise ValueError(f"spacing {step:g} m must be at most half the radius {radius:g} m")
    side = edges(-REACH * radius, REACH * radius, step)
    return ExactField(
        rectangles(side, side),
        density * smooth_averages(swirl.density_ratio_at, side, side),
        density,
        provenance=f"exact isentropic vortex of Mach {mach:g} and radius {radius:g} m",
        solution=swirl,
    )
