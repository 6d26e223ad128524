"""Perfect-gas relations along a streamline without shocks, the free stream of a wind tunnel, and standard air.

Reference: J. D. Anderson, Modern Compressible Flow, 3rd ed., eq 3.28, 3.30, 3.31.

The US Standard Atmosphere 1976 (NOAA-S/T 76-1562): in each layer the temperature is linear in the geopotential altitude
H = r z / (r + z), and hydrostatic balance gives p = p_b (T_b / T)^(g M / (R L)) for a lapse rate L, or
p = p_b exp(-g M (H - H_b) / (R T_b)) where L = 0.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from aerokernels.inputs.arguments import checked
from aerokernels.inputs.checks import check_at_least, check_positive

GAMMA_AIR = 1.4
# Universal gas constant over the molar mass of dry air, 8314.4626 / 28.9644 [J/(kg K)].
GAS_CONSTANT_AIR = 8314.4626 / 28.9644
SEA_LEVEL_DENSITY = 1.225  # [kg/m3], International Standard Atmosphere
SEA_LEVEL_TEMPERATURE = 288.15  # [K], International Standard Atmosphere
GREATEST_DENSITY = 1000.0  # [kg/m3], that of a liquid: greater values are mostly g/m3 taken for kg/m3
LEAST_DENSITY = 1e-6  # [kg/m3], that of air 95 km up: smaller values are mostly other units, or damaged data


@dataclass(frozen=True)
class Isentropic:
    """Ratios of static to stagnation values at one Mach number.

    Attributes:
        mach: Mach number.
        temperature_ratio: T / T0.
        pressure_ratio: p / p0.
        density_ratio: rho / rho0.
    """

    mach: float
    temperature_ratio: float
    pressure_ratio: float
    density_ratio: float


@dataclass(frozen=True)
class FreeStream:
    """A uniform supersonic or subsonic stream of a perfect gas.

    Attributes:
        mach: Mach number.
        density: [kg/m3].
        pressure: Static pressure [Pa].
        temperature: Static temperature [K].
        velocity: [m/s].
        sound_speed: [m/s].
        stagnation_pressure: [Pa].
        stagnation_temperature: [K].
        gamma: Ratio of specific heats.
        gas_constant: [J/(kg K)].
    """

    mach: float
    density: float
    pressure: float
    temperature: float
    velocity: float
    sound_speed: float
    stagnation_pressure: float
    stagnation_temperature: float
    gamma: float = GAMMA_AIR
    gas_constant: float = GAS_CONSTANT_AIR

    @checked
    def at_density(self, density: float) -> "FreeStream":
        """Return the stream of the same Mach number and temperature at another density [kg/m3]; pressures scale too."""
        ratio = check_positive(density, "density") / self.density
        return replace(
            self,
            density=float(density),
            pressure=self.pressure * ratio,
            stagnation_pressure=self.stagnation_pressure * ratio,
        )


@checked
def isentropic(mach: float, *, gamma: float = GAMMA_AIR) -> Isentropic:
    """Return the ratios of static to stagnation temperature, pressure and density.

    Raises:
        ValueError: A Mach number that is negative or not finite, or gamma not above 1.
    """
    if not (math.isfinite(mach) and mach >= 0.0):
        raise ValueError(f"mach must be zero or positive, got {mach!r}")
    check_gamma(gamma)
    ratio = 1.0 / (1.0 + 0.5 * (gamma - 1.0) * mach**2)
    return Isentropic(float(mach), ratio, ratio ** (gamma / (gamma - 1.0)), ratio ** (1.0 / (gamma - 1.0)))


@checked
def tunnel_conditions(
    mach: float,
    stagnation_pressure: float,
    stagnation_temperature: float,
    *,
    gamma: float = GAMMA_AIR,
    gas_constant: float = GAS_CONSTANT_AIR,
    density: float | None = None,
) -> FreeStream:
    """Return the free stream of a wind tunnel that expands gas at rest to a Mach number without losses.

    Args:
        mach: Mach number of the test section, above 0.
        stagnation_pressure: Pressure of the gas at rest [Pa].
        stagnation_temperature: Temperature of the gas at rest [K].
        gamma: Ratio of specific heats.
        gas_constant: [J/(kg K)].
        density: Free-stream density [kg/m3] to use instead of the isentropic one, such as a rounded published value.
            Temperature and velocity are unaffected; both pressures scale with the density.

    Raises:
        ValueError: A value that is not positive and finite, a pressure below 10 Pa or a temperature below 45 K at rest,
            or gamma not above 1.

    Examples:
        >>> round(tunnel_conditions(3.0, 0.36e6, 288.0).density, 4)
        0.3319
    """
    check_positive(mach, "mach")
    check_positive(stagnation_pressure, "stagnation_pressure")
    check_positive(stagnation_temperature, "stagnation_temperature")
    check_positive(gas_constant, "gas_constant")
    if stagnation_pressure < 10.0:  # mostly megapascals, below mostly degrees Celsius
        raise ValueError(
            f"stagnation_pressure of {stagnation_pressure:g} Pa is too low for a tunnel: give pascals, 630e3 for "
            "0.63 MPa"
        )
    if stagnation_temperature < 45.0:
        raise ValueError(
            f"stagnation_temperature of {stagnation_temperature:g} K is too low for a gas: give kelvins, 288 for "
            "15 degC"
        )
    ratio = isentropic(mach, gamma=gamma)
    temperature = stagnation_temperature * ratio.temperature_ratio
    pressure = stagnation_pressure * ratio.pressure_ratio
    static = (pressure / (gas_constant * temperature), pressure, temperature)
    stream = _stream(mach, static, (stagnation_pressure, stagnation_temperature), gamma, gas_constant)
    return stream if density is None else stream.at_density(density)


@checked
def free_stream(
    mach: float,
    density: float = SEA_LEVEL_DENSITY,
    temperature: float = SEA_LEVEL_TEMPERATURE,
    *,
    gamma: float = GAMMA_AIR,
    gas_constant: float = GAS_CONSTANT_AIR,
) -> FreeStream:
    """Return a uniform stream from its static state.

    Args:
        mach: Mach number, above 0.
        density: [kg/m3].
        temperature: Static temperature [K].
        gamma: Ratio of specific heats.
        gas_constant: [J/(kg K)].

    Raises:
        ValueError: A value that is not positive and finite, a density above 1000 kg/m3, or gamma not above 1.
    """
    check_positive(mach, "mach")
    check_density(density, "density")
    check_positive(temperature, "temperature")
    check_positive(gas_constant, "gas_constant")
    ratio = isentropic(mach, gamma=gamma)
    pressure = density * gas_constant * temperature
    stagnation = (pressure / ratio.pressure_ratio, temperature / ratio.temperature_ratio)
    return _stream(mach, (density, pressure, temperature), stagnation, gamma, gas_constant)


def _stream(
    mach: float,
    static: tuple[float, float, float],
    stagnation: tuple[float, float],
    gamma: float,
    gas_constant: float,
) -> FreeStream:
    """Return a stream of a static density, pressure and temperature, and a stagnation pressure and temperature."""
    density, pressure, temperature = map(float, static)
    sound_speed = math.sqrt(gamma * gas_constant * temperature)
    return FreeStream(
        mach=float(mach),
        density=density,
        pressure=pressure,
        temperature=temperature,
        velocity=mach * sound_speed,
        sound_speed=sound_speed,
        stagnation_pressure=float(stagnation[0]),
        stagnation_temperature=float(stagnation[1]),
        gamma=float(gamma),
        gas_constant=float(gas_constant),
    )


def stagnation_ratio(density: float, pressure: float, gamma: float) -> float:
    """Return p02 / p01 across a shock from rho2 / rho1 and p2 / p1."""
    if gamma > 1.02:
        return float(density ** (gamma / (gamma - 1.0)) * pressure ** (-1.0 / (gamma - 1.0)))
    # Near gamma = 1 both powers overflow or underflow, but their product does not.
    return math.exp((gamma * math.log(density) - math.log(pressure)) / (gamma - 1.0))


def check_density(density: float, name: str) -> float:
    """Return a gas density [kg/m3] as a float."""
    value = check_positive(density, name)
    if value < LEAST_DENSITY:
        raise ValueError(f"{name} of {value:g} kg/m3 is too small for a gas (at least {LEAST_DENSITY:g}): give kg/m3")
    if value > GREATEST_DENSITY:
        raise ValueError(
            f"{name} of {value:g} kg/m3 is too great for a gas (at most {GREATEST_DENSITY:g}): give kg/m3, 1.225 for "
            "1225 g/m3"
        )
    return value


def no_gas(density: np.ndarray, passed: np.ndarray | None = None) -> tuple[str, int, int] | None:
    """Return what is wrong with densities [kg/m3], how many are, and the flat index of the first; None if all are fine.

    Entries of `passed` are not used and may have any value.
    """
    if density.size and density.min() >= LEAST_DENSITY and density.max() <= GREATEST_DENSITY:  # false if there is a NaN
        return None
    for fault, bad in (
        ("not finite", ~np.isfinite(density)),
        ("not positive", density <= 0.0),
        (f"too small for a gas, below {LEAST_DENSITY:g} kg/m3", density < LEAST_DENSITY),
        (f"too great for a gas, above {GREATEST_DENSITY:g} kg/m3", density > GREATEST_DENSITY),
    ):
        bad = bad if passed is None else bad & ~passed
        if bad.any():
            return fault, int(bad.sum()), int(np.argmax(bad))
    return None


def check_gamma(gamma: float) -> None:
    """Raise ValueError for a ratio of specific heats that is not above 1."""
    if not (math.isfinite(gamma) and gamma > 1.0):
        raise ValueError(f"gamma must be above 1, got {gamma!r}: air has 1.4")


# The standard atmosphere's constants.
EARTH_RADIUS = 6_356_766.0  # [m], of the geopotential
HYDROSTATIC = 9.80665 * 28.9644e-3 / 8.31432  # g M / R [K/m]
GAS_CONSTANT = 8.31432 / 28.9644e-3  # of the standard's air [J/(kg K)]
HIGHEST = 86e3  # [m]
# Geopotential altitude of each layer's base [m], and its lapse rate [K/m].
LAYERS = ((0.0, -6.5e-3), (11e3, 0.0), (20e3, 1e-3), (32e3, 2.8e-3), (47e3, 0.0), (51e3, -2.8e-3), (71e3, -2e-3))


@dataclass(frozen=True)
class Atmosphere:
    """Air at rest: `density` [kg/m3], `pressure` [Pa] and `temperature` [K]."""

    density: float
    pressure: float
    temperature: float


@checked
def standard_atmosphere(altitude: float) -> Atmosphere:
    """Return the air of the US Standard Atmosphere 1976.

    Args:
        altitude: Geometric altitude above sea level [m], from 0 to 86 km.

    Raises:
        ValueError: An altitude out of range.

    Example:
        >>> round(standard_atmosphere(10e3).density, 5)
        0.41351
    """
    if not check_at_least(altitude, "altitude", 0.0) <= HIGHEST:
        raise ValueError(f"altitude = {altitude:g} m is above the standard atmosphere: give meters, at most 86e3")
    height = EARTH_RADIUS * altitude / (EARTH_RADIUS + altitude)
    temperature, pressure = 288.15, 101325.0
    for number, (base, lapse) in enumerate(LAYERS):
        top = min(height, LAYERS[number + 1][0] if number + 1 < len(LAYERS) else math.inf)
        below, temperature = temperature, temperature + lapse * (top - base)
        if lapse:
            pressure *= (below / temperature) ** (HYDROSTATIC / lapse)
        else:
            pressure *= math.exp(-HYDROSTATIC * (top - base) / below)
        if top == height:
            break
    return Atmosphere(pressure / (GAS_CONSTANT * temperature), pressure, temperature)
