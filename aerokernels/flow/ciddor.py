"""The refractive index of moist air by Ciddor's equations, 0.3 to 1.69 um; uncertainty 2e-8 to 5e-8 in n.

Temperature and pressure enter only through the densities of dry air and of vapour, so that refractivity over density
is a constant of the wavelength and the composition. References: P. E. Ciddor, Applied Optics 35 (1996) 1566, eq 1-5,
appendices A and B; group index: P. E. Ciddor and R. J. Hill, Applied Optics 38 (1999) 1663.
"""

import math

from aerokernels.inputs.arguments import checked
from aerokernels.inputs.checks import SAME, check_positive, check_wavelength, warn_caller

# Wavelengths for which the equations were fitted [m].
RANGE = (0.3e-6, 1.69e-6)
# State of moist air outside of which the compressibility is extrapolated: temperatures [K], and greatest pressure [Pa].
TEMPERATURE_RANGE, GREATEST_PRESSURE = (233.0, 373.3), 140e3
STANDARD_CO2 = 450e-6  # mole fraction in dry air
GREATEST_CO2 = 2000e-6
REFRACTIVITY_OF_CO2 = 0.534  # relative change of dry air's refractivity by the mole fraction that replaces O2
# Gas constant in Ciddor's paper [J/(mol K)]: his densities use it, and it cancels in their ratios.
GAS_CONSTANT = 8.314510
WATER_MOLAR_MASS = 0.018015  # [kg/mol]
# Relative: 3e-8 of 2.7e-4 in n - 1, and as much for the density of standard air (argon content, gas constant).
UNCERTAINTY = 1.5e-4


@checked
def ciddor_constant(wavelength: float, *, water: float = 0.0, co2: float = STANDARD_CO2, group: bool = False) -> float:
    """Return refractivity over density of moist air [m3/kg]; temperature and pressure do not affect it.

    Args:
        wavelength: Vacuum wavelength [m], 0.3 to 1.69 um.
        water: Mole fraction of water vapour in the moist air, 0 to 1: see `water_fraction`.
        co2: Mole fraction of carbon dioxide in the dry air, up to 2000 ppm.
        group: Return the group constant (n_g - 1) / density, by which a pulse travels.

    Raises:
        TypeError: The wavelength is not one number.
        ValueError: A wavelength or a fraction outside its range.
    """
    check_fractions(water, co2)
    wavelength, (low, high) = check_wavelength(wavelength), RANGE
    if not low * (1.0 - SAME) <= wavelength <= high * (1.0 + SAME):
        raise ValueError(
            f"wavelength {wavelength:g} m is outside Ciddor's {low * 1e6:g} to {high * 1e6:g} um: "
            "choose another relation"
        )
    dry, vapour = _standard_refractivities(1.0 / (wavelength * 1e6) ** 2, co2, group)
    dry_density = molar_mass(co2) * _molar_density(288.15, 101325.0, 0.0)  # both at the standard states
    vapour_density = WATER_MOLAR_MASS * _molar_density(293.15, 1333.0, 1.0)
    dry_share, vapour_share = (1.0 - water) * molar_mass(co2), water * WATER_MOLAR_MASS
    per_mass = dry_share * dry / dry_density + vapour_share * vapour / vapour_density
    return per_mass / (dry_share + vapour_share)


@checked
def ciddor_refractivity(
    wavelength: float,
    temperature: float,
    pressure: float,
    *,
    humidity: float = 0.0,
    co2: float = STANDARD_CO2,
) -> float:
    """Return the refractivity n - 1 of moist air at a temperature and pressure, by Ciddor's complete procedure.

    Args:
        wavelength: Vacuum wavelength [m], 0.3 to 1.69 um.
        temperature: [K].
        pressure: [Pa].
        humidity: Relative humidity, 0 to 1.
        co2: Mole fraction of carbon dioxide in the dry air, up to 2000 ppm.

    Raises:
        ValueError: A wavelength, humidity or fraction outside its range, a temperature or pressure that is not
            positive.
    """
    water = water_fraction(temperature, pressure, humidity)
    constant = ciddor_constant(wavelength, water=water, co2=co2)
    return constant * moist_air_density(temperature, pressure, water=water, co2=co2)


@checked
def moist_air_density(temperature: float, pressure: float, *, water: float = 0.0, co2: float = STANDARD_CO2) -> float:
    """Return the density of moist air [kg/m3] as a real gas (BIPM 1981/91, Ciddor's eq 4).

    Outside -40 to 100 degC and above 140 kPa the compressibility is extrapolated, with a warning: its error is about
    1e-3 at 600 K and 1e-2 at 1500 K (at 1e5 Pa).

    Args:
        temperature: [K].
        pressure: [Pa].
        water: Mole fraction of water vapour in the moist air, 0 to 1.
        co2: Mole fraction of carbon dioxide in the dry air.

    Raises:
        ValueError: A temperature or pressure that is not positive, or a fraction outside its range.
    """
    check_fractions(water, co2)
    check_positive(temperature, "temperature")
    check_positive(pressure, "pressure")
    low, high = TEMPERATURE_RANGE
    if not low <= temperature <= high or pressure > GREATEST_PRESSURE:
        warn_caller(
            f"the density of moist air at {temperature:g} K and {pressure:g} Pa is extrapolated: its compressibility "
            f"is known from {low:g} to {high:g} K and up to {GREATEST_PRESSURE:g} Pa",
        )
    mass = (1.0 - water) * molar_mass(co2) + water * WATER_MOLAR_MASS
    return mass * _molar_density(temperature, pressure, water)


@checked
def water_fraction(temperature: float, pressure: float, humidity: float) -> float:
    """Return the mole fraction of water vapour in air of a relative humidity (0 to 1), at [K] and [Pa].

    As in Ciddor's appendix, the saturation vapour pressure is Giacomo's over water from 0 degC up and Marti and
    Mauersberger's over ice below, multiplied by the enhancement factor of air.

    Raises:
        ValueError: A humidity outside 0 to 1, or one at which the vapour pressure would exceed the pressure.
    """
    check_positive(temperature, "temperature")
    check_positive(pressure, "pressure")
    if not 0.0 <= humidity <= 1.0:
        raise ValueError(f"humidity must be between 0 and 1, got {humidity!r}: give 0.5 for 50 %")
    celsius = temperature - 273.15
    if celsius >= -1e-9:
        logarithm = 1.2378847e-5 * temperature**2 - 1.9121316e-2 * temperature + 33.93711047 - 6.3431645e3 / temperature
        saturation = math.exp(logarithm)
    else:
        saturation = 10.0 ** (12.537 - 2663.5 / temperature)
    enhancement = 1.00062 + 3.14e-8 * pressure + 5.6e-7 * celsius**2
    water = enhancement * humidity * saturation / pressure
    if water > 1.0:
        raise ValueError(f"humidity {humidity:g} at {temperature:g} K needs a vapour pressure above {pressure:g} Pa")
    return water


def _standard_refractivities(square: float, co2: float, group: bool = False) -> tuple[float, float]:
    """Return n - 1, or n_g - 1, of standard dry air and of standard water vapour at a squared wavenumber [1/um2]."""
    first, second = 238.0185 - square, 57.362 - square
    dry = 1e-8 * (5792105.0 / first + 167917.0 / second)
    vapour = 1.022e-8 * (295.235 + square * (2.6422 + square * (-0.032380 + square * 0.004028)))
    if group:
        dry += 2e-8 * square * (5792105.0 / first**2 + 167917.0 / second**2)
        vapour += 2.044e-8 * square * (2.6422 + square * (-0.064760 + square * 0.012084))
    return dry * (1.0 + REFRACTIVITY_OF_CO2 * (co2 - STANDARD_CO2)), vapour


def molar_mass(co2: float) -> float:
    """Return the molar mass of dry air [kg/mol]: CO2 replaces O2, which adds the mass of a carbon atom."""
    return 1e-3 * (28.9635 + 12.011 * (co2 - 400e-6))


def _molar_density(temperature: float, pressure: float, water: float) -> float:
    """Return the molar density [mol/m3], with the compressibility of moist air."""
    celsius, ratio = temperature - 273.15, pressure / temperature
    first = 1.58123e-6 + celsius * (-2.9331e-8 + 1.1043e-10 * celsius)
    first += water * (5.707e-6 - 2.051e-8 * celsius) + water**2 * (1.9898e-4 - 2.376e-6 * celsius)
    compressibility = 1.0 - ratio * first + ratio**2 * (1.83e-11 - 0.765e-8 * water**2)
    return pressure / (compressibility * GAS_CONSTANT * temperature)


def check_fractions(water: float, co2: float) -> None:
    """Raise ValueError for a mole fraction of water vapour or of carbon dioxide out of range."""
    if not 0.0 <= water <= 1.0:
        raise ValueError(f"the mole fraction of water vapour must be between 0 and 1, got {water!r}")
    if not 0.0 <= co2 <= GREATEST_CO2:
        raise ValueError(
            f"the mole fraction of carbon dioxide must be between 0 and {GREATEST_CO2:g}, got {co2!r}: 450 ppm is "
            "450e-6; for other gases give the composition with relation 'gladstone-dale'"
        )
