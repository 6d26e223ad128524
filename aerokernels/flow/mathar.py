"""The refractive index of moist air in the infrared windows, by Mathar's expansion in five bands from 1.3 to 24 um.

In a band, n - 1 = sum_j c_j (s - s0)^j over wave numbers s = 1 / lambda [1/cm], and each c_j is a polynomial of second
degree in 1 / T - 1 / 290.65 K, in the relative humidity less 10 %, and in the pressure less 75 kPa. Between the bands
water vapour and carbon dioxide absorb. Reference: R. J. Mathar, J. Opt. A 9 (2007) 470, tables 1 to 5.
"""

from typing import NamedTuple

import numpy as np

from aerokernels.flow import ciddor
from aerokernels.flow.ciddor import STANDARD_CO2
from aerokernels.inputs.arguments import checked
from aerokernels.inputs.checks import SAME, check_positive, check_wavelength, warn_caller

# The state of which the coefficients are an expansion [K], [Pa], [%], and the mole fraction of CO2 in its dry air.
TEMPERATURE, PRESSURE, HUMIDITY, CO2 = 290.65, 75e3, 10.0, 370e-6
# Where the coefficients were fitted [K], [Pa].
TEMPERATURE_RANGE, PRESSURE_RANGE = (263.15, 298.15), (50e3, 102.3e3)


class _Band(NamedTuple):
    """A band [m], its reference wavelength [um], the relative uncertainty of n - 1, and the coefficients.

    Rows of coefficients are those of 1, t, t^2, h, h^2, p, p^2, t h, t p and h p, from the 0th to the 5th power of the
    wave number. The uncertainty is the difference from Ciddor's formula, continued, and grows towards lines.
    """

    low: float
    high: float
    reference: float
    uncertainty: float
    coefficients: tuple[tuple[float, ...], ...]


BANDS = (
    _Band(1.3e-6, 2.5e-6, 2.25, 3e-4, (
        (0.000200192, 1.13474e-10, -4.24595e-15, 1.00957e-17, -2.93315e-21, 3.07228e-25),
        (0.0588625, -3.85766e-8, 8.88019e-11, -5.6765e-14, 1.66615e-17, -1.74845e-21),
        (-3.01513, 0.000406167, -5.14544e-7, 3.43161e-10, -1.01189e-13, 1.06749e-17),
        (-1.03945e-8, 1.36858e-12, -1.71039e-15, 1.12908e-18, -3.29925e-22, 3.44747e-26),
        (5.73256e-13, 1.86367e-17, -2.2815e-20, 1.50947e-23, -4.41214e-27, 4.61209e-31),
        (2.67085e-9, 1.35941e-15, 1.35295e-19, 8.18218e-24, -2.22957e-27, 2.49964e-31),
        (6.09186e-18, 5.19024e-24, -4.19477e-28, 4.3412e-31, -1.22445e-34, 1.34816e-38),
        (4.97859e-5, -6.61752e-9, 8.32034e-12, -5.51793e-15, 1.61899e-18, -1.69901e-22),
        (7.79176e-7, 3.96499e-13, 3.95114e-17, 2.33587e-21, -6.36441e-25, 7.16868e-29),
        (-2.06567e-16, 1.06141e-21, -1.49982e-24, 9.84046e-28, -2.88266e-31, 2.99105e-35),
    )),
    _Band(2.8e-6, 4.2e-6, 3.4, 3e-4, (
        (0.000200049, 1.45221e-10, 2.50951e-13, -7.45834e-16, -1.61432e-18, 3.5278e-21),
        (0.0588432, -8.25182e-8, 1.37982e-10, 3.5242e-14, -7.30651e-16, -1.67911e-19),
        (-3.13579, 0.000694124, -5.00604e-7, -1.16668e-9, 2.09644e-12, 5.91037e-15),
        (-1.08142e-8, 2.30102e-12, -1.54652e-15, -3.23014e-18, 6.30616e-21, 1.7388e-23),
        (5.86812e-13, 3.12198e-17, -1.97792e-20, -4.61945e-23, 7.88398e-26, 2.4558e-28),
        (2.669e-9, 1.68162e-15, 3.53075e-18, -9.63455e-21, -2.23079e-23, 4.53166e-26),
        (6.0886e-18, 4.6156e-23, 1.84282e-25, -5.24471e-28, -1.21299e-30, 2.46512e-33),
        (5.17962e-5, -1.12149e-8, 7.76507e-12, 1.72569e-14, -3.20582e-17, -8.99435e-20),
        (7.78638e-7, 4.46396e-13, 7.846e-16, -1.95151e-18, -5.42083e-21, 1.0353e-23),
        (-2.17243e-16, 1.04747e-21, -5.23689e-24, 8.17386e-27, 3.09913e-29, -3.63491e-32),
    )),
    _Band(4.35e-6, 5.2e-6, 4.8, 5e-4, (
        (0.00020002, 2.75346e-10, 3.25702e-13, -6.93603e-15, 2.8561e-18, 3.38758e-19),
        (0.0590035, -3.75764e-7, 1.34585e-10, 1.24316e-12, 5.0851e-14, -1.89245e-16),
        (-4.0983, 0.00250037, 2.75187e-7, -6.53398e-9, -3.10589e-10, 1.27747e-12),
        (-1.40463e-8, 8.3935e-12, -1.90929e-15, -1.21399e-17, -8.98863e-19, 3.64662e-21),
        (5.43605e-13, 1.12802e-16, -2.29979e-20, -1.9145e-22, -1.20352e-23, 5.00955e-26),
        (2.66898e-9, 2.73629e-15, 4.63466e-18, -9.16894e-20, 1.36685e-22, 4.13687e-24),
        (6.10706e-18, 1.1662e-22, 2.44736e-25, -4.97682e-27, 7.42024e-30, 2.24625e-31),
        (6.74488e-5, -4.06775e-8, 2.89063e-12, 8.19898e-14, 4.68386e-15, -1.91182e-17),
        (7.78627e-7, 5.93296e-13, 1.45042e-15, 4.89815e-18, 3.27941e-20, 1.2802e-22),
        (-2.11676e-16, 4.87921e-21, -6.82545e-24, 9.42802e-26, -9.46422e-28, -1.53682e-30),
    )),
    _Band(7.5e-6, 14.1e-6, 10.1, 5e-4, (
        (0.000199885, 3.44739e-10, -2.73714e-13, 3.93383e-16, -5.69488e-18, 1.64556e-20),
        (0.05939, -1.72226e-6, 2.37654e-9, -3.81812e-12, 3.0505e-15, -1.57464e-17),
        (-6.50355, 0.010383, -1.39464e-5, 2.20077e-8, -2.72412e-11, 1.26364e-13),
        (-2.21938e-8, 3.47377e-11, -4.65991e-14, 7.35848e-17, -8.97119e-20, 3.80817e-22),
        (3.93524e-13, 4.64083e-16, -6.21764e-19, 9.81126e-22, -1.21384e-24, 5.15111e-27),
        (2.66809e-9, 6.95247e-16, 1.5907e-18, -3.03451e-21, -6.61489e-23, 1.78226e-25),
        (6.10508e-18, 2.27694e-23, 7.86323e-26, -1.74448e-28, -3.59791e-30, 9.78307e-33),
        (0.000106776, -1.68516e-7, 2.26201e-10, -3.56457e-13, 4.3798e-16, -1.94545e-18),
        (7.78368e-7, 2.16404e-13, 5.81805e-16, -1.89618e-18, -1.98869e-20, 5.89381e-23),
        (-2.06365e-16, 3.00234e-20, -4.26519e-23, 6.84306e-26, -4.6732e-30, 1.26117e-31),
    )),
    _Band(16e-6, 24e-6, 20, 1.2e-3, (
        (0.000199436, 2.99123e-9, -2.14862e-11, 1.43338e-13, 1.22398e-15, -1.14628e-17),
        (0.0621723, -1.77074e-5, 1.52213e-7, -9.54584e-10, -9.96706e-12, 9.21476e-14),
        (-23.2409, 0.108557, -0.00102439, 6.34072e-6, 7.62517e-8, -6.75587e-10),
        (-7.72707e-8, 3.47237e-10, -2.72675e-12, 1.70858e-14, 1.56889e-16, -1.50004e-18),
        (-3.26604e-13, 4.63606e-15, -3.64272e-17, 2.28756e-19, 2.09502e-21, -2.00547e-23),
        (2.66827e-9, 1.20788e-15, 5.22646e-18, 7.83027e-20, 7.53235e-22, -2.28819e-25),
        (6.13675e-18, 5.85494e-23, 2.86055e-25, 4.25193e-27, 4.13455e-29, -8.12941e-33),
        (0.000375974, -1.71849e-6, 1.46704e-8, -9.17231e-11, -9.55922e-13, 8.80502e-15),
        (7.78436e-7, 4.6184e-13, 3.06229e-15, -6.23183e-17, -1.61119e-19, 8.00756e-21),
        (-2.72614e-16, 3.04662e-19, -2.3959e-21, 1.49285e-23, 1.36086e-25, -1.30999e-27),
    )),
)  # fmt: skip


@checked
def mathar_refractivity(
    wavelength: float,
    temperature: float,
    pressure: float,
    *,
    humidity: float = 0.0,
    co2: float = STANDARD_CO2,
    group: bool = False,
) -> float:
    """Return the refractivity n - 1 of moist air in an infrared window, by Mathar's complete expansion.

    The fit is to 263 to 298 K, 50 to 102.3 kPa and 5 to 60 % humidity; outside of these temperatures and pressures a
    warning names what is extrapolated.

    Args:
        wavelength: Vacuum wavelength [m], in 1.3 to 2.5, 2.8 to 4.2, 4.35 to 5.2, 7.5 to 14.1 or 16 to 24 um.
        temperature: [K].
        pressure: [Pa].
        humidity: Relative humidity, 0 to 1.
        co2: Mole fraction of carbon dioxide in the dry air. The expansion is for 370 ppm; other fractions scale the
            dry air's share as in Ciddor's equations.
        group: Return n_g - 1 of the group index, by which a pulse travels.

    Raises:
        ValueError: A wavelength outside the bands, a humidity or fraction outside its range, a temperature or pressure
            that is not positive.

    Example:
        >>> round(1e6 * mathar_refractivity(10.1e-6, 290.65, 75e3, humidity=0.1, co2=370e-6), 3)
        199.885
    """
    check_positive(temperature, "temperature")
    check_positive(pressure, "pressure")
    water = ciddor.water_fraction(temperature, pressure, humidity)
    (low, high), (least, most) = TEMPERATURE_RANGE, PRESSURE_RANGE
    if not (low <= temperature <= high and least <= pressure <= most):
        by_density = mathar_constant(wavelength, water=water, co2=co2, group=group)
        by_density *= ciddor.moist_air_density(temperature, pressure, water=water, co2=co2)
        warn_caller(
            f"Mathar's expansion is extrapolated to {temperature:g} K and {pressure:g} Pa from {low:g} to {high:g} K "
            f"and {least:g} to {most:g} Pa: refractivity in proportion to density would give {by_density:.4g}"
        )
    dry, _ = _constants(wavelength, group)
    share = (1.0 - water) * ciddor.molar_mass(co2) / _mean_mass(water, co2)
    density = ciddor.moist_air_density(temperature, pressure, water=water, co2=co2)
    return _expansion(wavelength, temperature, pressure, 100.0 * humidity, group) + dry * share * density * _of_co2(co2)


@checked
def mathar_constant(wavelength: float, *, water: float = 0.0, co2: float = STANDARD_CO2, group: bool = False) -> float:
    """Return refractivity over density of moist air [m3/kg] in an infrared window.

    Dry air and vapour have each a constant, that of the expansion at its center, 290.65 K and 75 kPa.

    Args:
        wavelength: Vacuum wavelength [m], in one of the bands of `mathar_refractivity`.
        water: Mole fraction of water vapour in the moist air, 0 to 1: see `water_fraction`.
        co2: Mole fraction of carbon dioxide in the dry air, up to 2000 ppm.
        group: Return the group constant (n_g - 1) / density, by which a pulse travels.

    Raises:
        TypeError: The wavelength is not one number.
        ValueError: A wavelength outside the bands, or a fraction outside its range.
    """
    ciddor.check_fractions(water, co2)
    dry, vapour = _constants(wavelength, group)
    dry_share = (1.0 - water) * ciddor.molar_mass(co2) / _mean_mass(water, co2)
    dry *= (1.0 + _of_co2(co2)) * ciddor.molar_mass(CO2) / ciddor.molar_mass(co2)  # for the same number of molecules
    return dry_share * dry + (1.0 - dry_share) * vapour


def _band(wavelength: float) -> _Band:
    wavelength = check_wavelength(wavelength)
    for band in BANDS:
        if band.low * (1.0 - SAME) <= wavelength <= band.high * (1.0 + SAME):
            return band
    listed = ", ".join(f"{1e6 * band.low:g} to {1e6 * band.high:g}" for band in BANDS)
    raise ValueError(
        f"wavelength {wavelength:g} m is outside Mathar's bands of {listed} um: choose another relation or give a "
        "constant with relation 'gladstone-dale'"
    )


def _expansion(wavelength: float, temperature: float, pressure: float, humidity: float, group: bool) -> float:
    """Return n - 1, or n_g - 1 = n - 1 + s dn/ds; the humidity in %."""
    band = _band(wavelength)
    t, p, h = 1.0 / temperature - 1.0 / TEMPERATURE, pressure - PRESSURE, humidity - HUMIDITY
    series = np.array([1.0, t, t * t, h, h * h, p, p * p, t * h, t * p, h * p]) @ np.array(band.coefficients)
    wave_number = 1e-2 / wavelength
    powers = np.power(wave_number - 1e4 / band.reference, np.arange(6))
    slope = wave_number * float(series[1:] @ (np.arange(1, 6) * powers[:-1])) if group else 0.0
    return float(series @ powers) + slope


def _constants(wavelength: float, group: bool) -> tuple[float, float]:
    """Return the constants of the expansion's dry air and of vapour [m3/kg]."""
    alone = _expansion(wavelength, TEMPERATURE, PRESSURE, 0.0, group)
    dry = alone / ciddor.moist_air_density(TEMPERATURE, PRESSURE, co2=CO2)
    water = ciddor.water_fraction(TEMPERATURE, PRESSURE, 0.3)
    density = ciddor.moist_air_density(TEMPERATURE, PRESSURE, water=water, co2=CO2)
    vapour_density = density * water * ciddor.WATER_MOLAR_MASS / _mean_mass(water, CO2)
    moist = _expansion(wavelength, TEMPERATURE, PRESSURE, 30.0, group)
    return dry, (moist - dry * (density - vapour_density)) / vapour_density


def _of_co2(co2: float) -> float:
    return ciddor.REFRACTIVITY_OF_CO2 * (co2 - CO2)


def _mean_mass(water: float, co2: float) -> float:
    return (1.0 - water) * ciddor.molar_mass(co2) + water * ciddor.WATER_MOLAR_MASS
