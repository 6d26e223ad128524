r"""The bow shock of a sphere or a cylinder across the stream: Billig's correlation, which is approximate.

The shock is the hyperbola z = d - Rc cot^2 b (sqrt(1 + (r tan b / Rc)^2) - 1), the nose at z = 0 and r across, that
ends in the Mach angle b of the stream, with stand-off d and radius of curvature Rc at the nose fitted to experiments in
air:

    sphere      d / R = 0.143 exp(3.24 / M^2)     Rc / R = 1.143 exp(0.54 / (M - 1)^1.2)
    cylinder    d / R = 0.386 exp(4.67 / M^2)     Rc / R = 1.386 exp(1.8 / (M - 1)^0.75)

Reference: F. S. Billig, Shock-wave shapes around spherical- and cylindrical-nosed bodies, J. Spacecraft Rockets 4
(1967) 822; J. D. Anderson, Hypersonic and High Temperature Gas Dynamics, eq 5.36-5.38.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..inputs.arguments import checked
from ..inputs.checks import check_choice, check_positive

LEAST_MACH = 1.5
# geometry: (stand-off factor, its exponent, curvature factor, its exponent, power of M - 1)
_FITS = {"axisymmetric": (0.143, 3.24, 1.143, 0.54, 1.2), "planar": (0.386, 4.67, 1.386, 1.8, 0.75)}


@dataclass(frozen=True)
class BowShock:
    """The shape of a bow shock ahead of a round nose. Lengths in m, the nose at z = 0, the stream from +z.

    Attributes:
        mach: Mach number of the free stream.
        radius: Radius of the nose.
        stand_off: Distance of the shock ahead of the nose.
        curvature_radius: Radius of curvature of the shock on the axis.
        far_angle: Angle to the stream that the shock ends in [rad]: the Mach angle.
        geometry: "axisymmetric" for a sphere, "planar" for a cylinder across the stream.
    """

    mach: float
    radius: float
    stand_off: float
    curvature_radius: float
    far_angle: float
    geometry: str

    @property
    def _depth(self) -> float:
        """Rc cot^2 b: how far the hyperbola's centre lies ahead of its vertex."""
        return self.curvature_radius / math.tan(self.far_angle) ** 2

    def z_at(self, r) -> np.ndarray:
        """Position z of the shock at distances from the axis [m]."""
        stretch = np.asarray(r, dtype=np.float64) * (math.tan(self.far_angle) / self.curvature_radius)
        # sqrt(1 + s^2) - 1 without a difference of nearly equal numbers.
        return self.stand_off - self._depth * stretch**2 / (1.0 + np.sqrt(1.0 + stretch**2))

    def radius_at(self, z) -> np.ndarray:
        """Distance of the shock from the axis [m] at z; 0 ahead of it."""
        behind = np.maximum(self.stand_off - np.asarray(z, dtype=np.float64), 0.0) / self._depth
        return self.curvature_radius / math.tan(self.far_angle) * np.sqrt(behind * (behind + 2.0))

    def distance_along(self, angle) -> np.ndarray:
        """Distance of the shock from the nose's centre of curvature [m], in directions from the axis [rad] to pi/2."""
        cosine, sine = np.cos(angle), np.sin(angle)
        centre = self.radius + self.stand_off + self._depth
        cotangent = sine / math.tan(self.far_angle)
        product = (self.radius + self.stand_off) * (centre + self._depth)  # centre^2 - depth^2
        return product / (centre * cosine + np.sqrt((self._depth * cosine) ** 2 + cotangent**2 * product))

    def normal_mach_square_at(self, r) -> np.ndarray:
        """Square of the Mach number normal to the shock at distances from the axis [m]."""
        r = np.asarray(r, dtype=np.float64)
        square = self.curvature_radius**2 + (r * math.tan(self.far_angle)) ** 2
        return self.mach**2 * square / (square + r**2)


@checked
def bow_shock(mach: float, radius: float, *, geometry: str = "axisymmetric") -> BowShock:
    """The bow shock of a round nose by Billig's correlation: approximate, fitted to experiments in air.

    Args:
        mach: Mach number of the free stream, at least 1.5; the experiments lie above 2.
        radius: Radius of the nose [m].
        geometry: "axisymmetric" for a sphere, "planar" for a cylinder across the stream.

    Raises:
        ValueError: A Mach number below 1.5 or not finite, a radius that is not positive, or an unknown geometry.
    """
    if not (math.isfinite(mach) and mach >= LEAST_MACH):
        raise ValueError(f"mach must be at least {LEAST_MACH:g} for Billig's correlation, got {mach!r}")
    check_positive(radius, "radius")
    check_choice(geometry, "geometry", _FITS)
    near, near_power, bend, bend_power, power = _FITS[geometry]
    return BowShock(
        mach=float(mach),
        radius=float(radius),
        stand_off=radius * near * math.exp(near_power / mach**2),
        curvature_radius=radius * bend * math.exp(bend_power / (mach - 1.0) ** power),
        far_angle=math.asin(1.0 / mach),
        geometry=geometry,
    )
