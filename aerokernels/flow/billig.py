r"""The shape of the bow shock ahead of a sphere or of a cylinder across the stream, by Billig's correlation.

The correlation is approximate. It takes the shock to be the hyperbola

    z = d - Rc cot^2 b (sqrt(1 + (r tan b / Rc)^2) - 1)

with the nose at z = 0 and r measured from the axis. The hyperbola's asymptotes make the stream's Mach angle b with the
axis. The stand-off d and the radius of curvature Rc at the vertex are fitted to experiments in air (R: nose radius):

    sphere      d / R = 0.143 exp(3.24 / M^2)     Rc / R = 1.143 exp(0.54 / (M - 1)^1.2)
    cylinder    d / R = 0.386 exp(4.67 / M^2)     Rc / R = 1.386 exp(1.8 / (M - 1)^0.75)

Reference: F. S. Billig, Shock-wave shapes around spherical- and cylindrical-nosed bodies, J. Spacecraft Rockets 4
(1967) 822; J. D. Anderson, Hypersonic and High Temperature Gas Dynamics, eq 5.36-5.38.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..inputs.arguments import Numbers, checked
from ..inputs.checks import check_choice, check_positive

LEAST_MACH = 1.5
# geometry: (stand-off factor, its exponent, curvature factor, its exponent, power of M - 1)
_FITS = {"axisymmetric": (0.143, 3.24, 1.143, 0.54, 1.2), "planar": (0.386, 4.67, 1.386, 1.8, 0.75)}


@dataclass(frozen=True)
class BowShock:
    """The shape of a bow shock ahead of a round nose. The nose is at z = 0 [m]; the stream comes from +z.

    Attributes:
        mach: Mach number of the free stream.
        radius: Radius of the nose [m].
        stand_off: Distance of the shock ahead of the nose [m].
        curvature_radius: Radius of curvature of the shock on the axis [m].
        far_angle: Angle between the shock far away and the stream [rad]: the Mach angle.
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
        """Rc cot^2 b: distance from the hyperbola's vertex to its centre, which is ahead of the vertex [m]."""
        return self.curvature_radius / math.tan(self.far_angle) ** 2

    @checked
    def z_at(self, r: Numbers) -> np.ndarray:
        """Position z of the shock [m] at distances r from the axis [m]."""
        stretch = np.asarray(r, dtype=np.float64) * (math.tan(self.far_angle) / self.curvature_radius)
        # s^2 / (1 + sqrt(1 + s^2)) is sqrt(1 + s^2) - 1 without the difference of nearly equal numbers.
        return self.stand_off - self._depth * stretch**2 / (1.0 + np.sqrt(1.0 + stretch**2))

    @checked
    def radius_at(self, z: Numbers) -> np.ndarray:
        """Distance of the shock from the axis [m] at positions z [m]; 0 ahead of the shock's vertex."""
        behind = np.maximum(self.stand_off - np.asarray(z, dtype=np.float64), 0.0) / self._depth
        return self.curvature_radius / math.tan(self.far_angle) * np.sqrt(behind * (behind + 2.0))

    @checked
    def distance_along(self, angle: Numbers) -> np.ndarray:
        """Distance [m] of the shock from the nose's centre of curvature, at angles 0 to pi/2 from the axis [rad]."""
        cosine, sine = np.cos(angle), np.sin(angle)
        centre = self.radius + self.stand_off + self._depth
        cotangent = sine / math.tan(self.far_angle)
        product = (self.radius + self.stand_off) * (centre + self._depth)  # centre^2 - depth^2
        return product / (centre * cosine + np.sqrt((self._depth * cosine) ** 2 + cotangent**2 * product))

    @checked
    def normal_mach_square_at(self, r: Numbers) -> np.ndarray:
        """Square of the Mach number normal to the shock at distances r from the axis [m]."""
        r = np.asarray(r, dtype=np.float64)
        square = self.curvature_radius**2 + (r * math.tan(self.far_angle)) ** 2
        return self.mach**2 * square / (square + r**2)


@checked
def bow_shock(mach: float, radius: float, *, geometry: str = "axisymmetric") -> BowShock:
    """Return the bow shock of a round nose by Billig's correlation, which is fitted to experiments in air.

    Args:
        mach: Mach number of the free stream, at least 1.5; the experiments were made above Mach 2.
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
