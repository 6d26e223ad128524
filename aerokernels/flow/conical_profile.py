"""The solution for the flow over a cone: named values, and density and velocity at any polar angle."""

from dataclasses import dataclass, field

import numpy as np

from ..inputs.arguments import Numbers, checked


@dataclass(frozen=True, eq=False)
class ConicalProfile:
    """The flow between wall and shock as a function of the angle below the shock, s = shock_angle - polar angle [rad].

    Attributes:
        depth: Increasing s, from 0 at the shock to the wall, shape (n,).
        radial: u = v_r - cos t over the free stream's speed, shape (n,).
        polar: w = v_t + sin t over the free stream's speed, shape (n,).
        polar_slope: dw / ds, shape (n,).
    """

    depth: np.ndarray
    radial: np.ndarray
    polar: np.ndarray
    polar_slope: np.ndarray

    def deviation(self, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the deviation (u, w) at each s between shock and wall, by cubics through values and slopes."""
        right = np.clip(np.searchsorted(self.depth, depth), 1, len(self.depth) - 1)
        width = self.depth[right] - self.depth[right - 1]
        x = (depth - self.depth[right - 1]) / width
        # du / ds = -w: the flow has no vorticity.
        radial = _hermite(x, width, right, self.radial, -self.polar)
        return radial, _hermite(x, width, right, self.polar, self.polar_slope)


def _hermite(x, width, right, value, slope):
    before, after = value[right - 1], value[right]
    y = 1.0 - x
    ends = before + x**2 * (3.0 - 2.0 * x) * (after - before)
    return ends + width * x * y * (y * slope[right - 1] - x * slope[right])


@dataclass(frozen=True)
class ConeShock:
    """The flow over a cone, relative to the free stream.

    Attributes:
        mach: Mach number of the free stream.
        half_angle: Half angle of the cone [rad].
        shock_angle: Angle between the shock and the axis [rad].
        deflection: Angle by which the shock turns the flow [rad]; the rest of the turn happens between shock and wall.
        density_ratio: rho2 / rho1 across the shock.
        pressure_ratio: p2 / p1 across the shock.
        temperature_ratio: T2 / T1 across the shock.
        stagnation_pressure_ratio: p02 / p01, the same everywhere behind the shock.
        downstream_mach: Mach number just behind the shock.
        surface_mach: Mach number at the wall.
        surface_density_ratio: Density at the wall over that of the free stream.
        surface_pressure_ratio: Pressure at the wall over that of the free stream.
        surface_temperature_ratio: Temperature at the wall over that of the free stream.
        gamma: Ratio of specific heats.
        profile: The flow between wall and shock.
    """

    mach: float
    half_angle: float
    shock_angle: float
    deflection: float
    density_ratio: float
    pressure_ratio: float
    temperature_ratio: float
    stagnation_pressure_ratio: float
    downstream_mach: float
    surface_mach: float
    surface_density_ratio: float
    surface_pressure_ratio: float
    surface_temperature_ratio: float
    gamma: float
    profile: ConicalProfile = field(repr=False, compare=False)

    @checked
    def density_ratio_at(self, polar_angle: Numbers) -> np.ndarray:
        """Return density over that of the free stream at polar angles [rad]; inside the body the value at the wall."""
        angle = np.asarray(polar_angle, dtype=np.float64)
        ahead = angle > self.shock_angle  # NaN is not, and stays NaN
        u, w = self.profile.deviation(self._depth(angle))
        excess = temperature_excess(self.mach, self.gamma, np.clip(angle, self.half_angle, self.shock_angle), u, w)
        ratio = self.stagnation_pressure_ratio * (1.0 + excess) ** (1.0 / (self.gamma - 1.0))
        return np.where(ahead, 1.0, ratio)

    @checked
    def velocity_at(self, polar_angle: Numbers) -> tuple[np.ndarray, np.ndarray]:
        """Return the radial and polar velocity about the tip, over the free stream's speed, at polar angles [rad].

        The polar velocity is positive toward greater angles, so it is negative here. Inside the body both have their
        values at the wall.
        """
        angle = np.asarray(polar_angle, dtype=np.float64)
        ahead = angle > self.shock_angle
        outside = np.maximum(angle, self.half_angle)
        u, w = self.profile.deviation(self._depth(angle))
        return np.cos(outside) + np.where(ahead, 0.0, u), np.where(ahead, 0.0, w) - np.sin(outside)

    def _depth(self, angle: np.ndarray) -> np.ndarray:
        return np.clip(self.shock_angle - angle, 0.0, self.profile.depth[-1])


def temperature_excess(mach, gamma, angle, u, w):
    """Return T / T1 - 1 at a polar angle [rad] from the deviation (u, w), by conservation of total enthalpy."""
    square = u * (2.0 * np.cos(angle) + u) + w * (w - 2.0 * np.sin(angle))
    return -0.5 * (gamma - 1.0) * mach**2 * square
