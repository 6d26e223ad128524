r"""The isentropic vortex: a steady swirl of one entropy, with its density in closed form.

    v(r) = a M (r / R) exp((1 - r^2 / R^2) / 2),       T / T1 = 1 - (g - 1) / 2 M^2 exp(1 - r^2 / R^2),
    rho / rho1 = (T / T1)^(1 / (g - 1)),               p / p1 = (T / T1)^(g / (g - 1))

with a the sound speed far away: v is greatest, M a, at the radius R. It solves the Euler equations: dp / dr is
rho v^2 / r.

Reference: C.-W. Shu, in Advanced Numerical Approximation of Nonlinear Hyperbolic Equations, LNM 1697 (1998), where its
strength is epsilon = 2 pi M sqrt(g), in units of R and of p / rho far away.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..inputs.arguments import Numbers, checked
from ..inputs.checks import check_positive
from .exact_averages import smooth_averages
from .exact_field import ExactField, edges, rectangles
from .gas import GAMMA_AIR, SEA_LEVEL_DENSITY, check_density, check_gamma

# Where the field ends, in radii: there the temperature differs from the ambient one by 1e-15 of the difference inside.
REACH = 6.0
CELLS_PER_RADIUS = 40


@dataclass(frozen=True)
class Vortex:
    """An isentropic vortex about the line x = 0, y = 0, z = 0 of the optical frame.

    Attributes:
        mach: Greatest speed of the swirl over the sound speed far away.
        radius: Where the swirl is fastest [m].
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
                f"mach {self.mach:g} empties the vortex: it must be below {greatest:.6g}, where the gas in the middle "
                f"reaches vacuum (gamma {self.gamma:g})"
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
    """The isentropic vortex as a planar density field, its axis along x, its middle at the origin.

    The field reaches six radii to each side, where the density is the ambient one to rounding. Cell averages by Gauss's
    rule are good to 1e-11 for cells up to half a radius.

    Args:
        mach: Greatest speed of the swirl over the sound speed far away; below 1.356 in air.
        radius: Where the swirl is fastest [m].
        density: Density far away [kg/m3].
        spacing: Greatest width of the cells, square ones [m]; None takes 1/40 of the radius.
        gamma: Ratio of specific heats.

    Returns:
        The field; `solution` is the vortex with its relations.

    Raises:
        ValueError: A quantity that is not positive, a Mach number at which the middle reaches vacuum (the message gives
            the limit), gamma not above 1, or a spacing above half a radius or for too many cells.
    """
    swirl = Vortex(float(mach), float(radius), float(gamma))
    check_density(density, "density")
    step = radius / CELLS_PER_RADIUS if spacing is None else check_positive(spacing, "spacing")
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
