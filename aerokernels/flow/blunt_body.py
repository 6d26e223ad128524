"""The flow ahead of and around a round nose as a density field: an approximation behind Billig's bow shock.

The density is that of the oblique shock of the local slope just behind the shock, that of the modified Newtonian
pressure on the wall, and linear between along the wall's normal. Reference: F. S. Billig, J. Spacecraft Rockets 4
(1967) 822, a fit to experiments in air; J. D. Anderson, Hypersonic and High Temperature Gas Dynamics, eq 5.36-5.38.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from aerokernels.flow.exact_field import MARGIN, ExactField, edges, rectangles, square_step, unit_gauss
from aerokernels.flow.gas import (
    GAMMA_AIR,
    GAS_CONSTANT_AIR,
    SEA_LEVEL_DENSITY,
    SEA_LEVEL_TEMPERATURE,
    free_stream,
    isentropic,
)
from aerokernels.flow.shocks import density_jump, normal_shock
from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.inputs.checks import check_choice, check_positive
from aerokernels.medium import Body

LEAST_MACH = 1.5
# geometry: (stand-off factor, its exponent, curvature factor, its exponent, power of M - 1)
_FITS = {"axisymmetric": (0.143, 3.24, 1.143, 0.54, 1.2), "planar": (0.386, 4.67, 1.386, 1.8, 0.75)}


@dataclass(frozen=True)
class BowShock:
    """The shape of a bow shock ahead of a round nose. The nose is at z = 0 [m]; the stream comes from +z.

    It is the hyperbola z = d - Rc cot^2 b (sqrt(1 + (r tan b / Rc)^2) - 1), r measured from the axis.

    Attributes:
        mach: Mach number of the free stream.
        radius: Radius of the nose [m].
        stand_off: Distance d of the shock ahead of the nose [m].
        curvature_radius: Radius of curvature Rc of the shock on the axis [m].
        far_angle: Angle b between the shock far away and the stream [rad]: the Mach angle.
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


@dataclass(frozen=True)
class BluntBodyFlow:
    """The approximate flow between a bow shock and a round nose with a straight body behind the nose.

    Attributes:
        bow: The shock's shape.
        stagnation_density_ratio: Density at the nose over that of the free stream.
        pressure_share: Pressure of the free stream over that at the nose.
        gamma: Ratio of specific heats.
    """

    bow: BowShock
    stagnation_density_ratio: float
    pressure_share: float
    gamma: float

    @checked
    def density_ratio_at(self, y: Numbers, z: Numbers) -> np.ndarray:
        """Density over that of the free stream at (y, z) or (r, z) [m]; inside the body the value at the wall."""
        r, z = np.abs(np.asarray(y, dtype=np.float64)), np.asarray(z, dtype=np.float64)
        return np.where(z < self.bow.z_at(r), self.behind_at(r, z), 1.0)

    def behind_at(self, r, z) -> np.ndarray:
        """Density over that of the free stream at r >= 0 and z [m], continued smoothly to points ahead of the shock."""
        radius = self.bow.radius
        ahead = z + radius  # ahead of the nose's centre of curvature
        on_nose = ahead > 0.0
        angle = np.where(on_nose, np.arctan2(r, np.maximum(ahead, 0.0)), 0.5 * math.pi)
        distance = np.where(on_nose, np.hypot(r, ahead), r)
        reach = np.where(on_nose, self.bow.distance_along(angle), self.bow.radius_at(z))
        share = np.maximum(distance - radius, 0.0) / (reach - radius)
        shock = self.shock_ratio_at(np.where(on_nose, reach * np.sin(angle), reach))
        pressure = self.pressure_share + (1.0 - self.pressure_share) * np.cos(angle) ** 2  # modified Newtonian
        wall = self.stagnation_density_ratio * pressure ** (1.0 / self.gamma)
        return (1.0 - share) * wall + share * shock

    def shock_ratio_at(self, r) -> np.ndarray:
        """Density just behind the shock over the free stream's, exact for the shock's slope at r from the axis [m]."""
        return density_jump(self.bow.normal_mach_square_at(r), self.gamma)


@checked
def blunt_body(
    mach: float,
    radius: float,
    *,
    geometry: str = "axisymmetric",
    density: float = SEA_LEVEL_DENSITY,
    temperature: float = SEA_LEVEL_TEMPERATURE,
    length: float | None = None,
    spacing: float | None = None,
    gamma: float = GAMMA_AIR,
    gas_constant: float = GAS_CONSTANT_AIR,
) -> ExactField:
    """Return the approximate flow over a hemisphere-cylinder, or over a slab with a round nose, as a density field.

    The shock is Billig's, whose stand-off is accurate to some per cent. The density between shock and wall is a model
    that is exact only on the axis, at the shock and at the wall. The averages of cells cut by the shock are those of
    the model to 1e-13; at the wall, where the model has a kink, to 1e-3.

    Args:
        mach: Mach number of the free stream, at least 1.5.
        radius: Radius of the nose [m]; the nose is at the origin.
        geometry: "axisymmetric" for a hemisphere on a cylinder, "planar" for half a circular cylinder across the
            stream.
        density: Density of the free stream [kg/m3].
        temperature: Static temperature of the free stream [K]; affects only pressure and velocity in `conditions`.
        length: Length of the body [m], at least the radius; None takes twice the radius. The field ends there.
        spacing: Greatest side of the square cells [m]; None takes 1/50 of the radius.
        gamma: Ratio of specific heats; Billig's experiments were in air.
        gas_constant: [J/(kg K)].

    Raises:
        ValueError: A Mach number below 1.5, a quantity that is not positive, an unknown geometry, a length below the
            radius, or a spacing for too few or too many cells.
    """
    bow = bow_shock(mach, radius, geometry=geometry)
    end = 2.0 * radius if length is None else check_positive(length, "length")
    if end < radius:
        raise ValueError(f"length {end:g} m ends the body within its nose: it must be at least the radius {radius:g} m")
    stream = free_stream(mach, density, temperature, gamma=gamma, gas_constant=gas_constant)
    shock = normal_shock(mach, gamma=gamma)
    flow = BluntBodyFlow(
        bow=bow,
        stagnation_density_ratio=shock.density_ratio / isentropic(shock.downstream_mach, gamma=gamma).density_ratio,
        pressure_share=isentropic(mach, gamma=gamma).pressure_ratio / shock.stagnation_pressure_ratio,
        gamma=float(gamma),
    )
    step = square_step(radius, spacing, 50)
    reach = float(bow.radius_at(-end)) + MARGIN * step
    z = edges(-end, bow.stand_off + MARGIN * step, step)
    r = edges(0.0, reach, step)
    planar = geometry == "planar"
    mesh = rectangles(np.concatenate([-r[:0:-1], r]) if planar else r, z, geometry)
    ratio = _averages(flow, r, z, weighted=not planar)
    if planar:
        ratio = np.concatenate([ratio[::-1], ratio])
    nose = f"a {'hemisphere' if geometry == 'axisymmetric' else 'cylinder'} of radius {radius:g} m at Mach {mach:g}"
    return ExactField(
        mesh,
        density * ratio,
        density,
        Body(_outline(radius, -z[0], geometry), geometry),
        stream,
        f"approximate flow over {nose} (Billig's shock, modified Newtonian wall)",
        flow,
    )


def _averages(flow: BluntBodyFlow, r: np.ndarray, z: np.ndarray, *, weighted: bool) -> np.ndarray:
    """Return averages over rectangles [r, z], weighted by r (volumes of revolution) if `weighted`.

    Along z the Gauss points end at the shock, and along r the integral is split where it enters and leaves the cell.
    """
    share, weight = unit_gauss(6)
    low, high = z[:-1], z[1:]
    result = np.empty((len(r) - 1, len(z) - 1))
    for row, (inner, outer) in enumerate(pairwise(r)):
        cuts = np.stack(
            [
                np.full_like(low, inner),
                *(np.clip(flow.bow.radius_at(face), inner, outer) for face in (high, low)),
                np.full_like(low, outer),
            ]
        )
        total = np.zeros_like(low)
        for start, end in pairwise(cuts):
            across = start[:, None] + (end - start)[:, None] * share
            behind = np.clip(flow.bow.z_at(across), low[:, None], high[:, None]) - low[:, None]
            along = low[:, None, None] + behind[..., None] * share
            inside = flow.behind_at(across[..., None], along) @ weight
            column = (behind * inside + (high - low)[:, None] - behind) * (across if weighted else 1.0)
            total += (end - start) * (column @ weight)
        area = 0.5 * (outer**2 - inner**2) if weighted else outer - inner
        result[row] = total / (area * (high - low))
    return result


def _outline(radius: float, length: float, geometry: str) -> np.ndarray:
    """Return the body's profile: from the nose along the quarter circle and the straight side to the base."""
    angle = np.linspace(0.0, 0.5 * math.pi, 180 + 1)  # around a quarter of the nose
    side = np.stack([radius * np.sin(angle), radius * (np.cos(angle) - 1.0)], axis=1)
    side[0] = 0.0
    side[-1, 0] = radius
    if length > radius * (1.0 + 1e-12):
        side = np.vstack([side, [radius, -length]])
    if geometry == "axisymmetric":
        return np.vstack([side, [0.0, -length]])
    return np.vstack([side, side[:0:-1] * [-1.0, 1.0]])
