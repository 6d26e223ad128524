"""Ciddor's refractive index of air against the values that he and NIST published."""

import pytest

from aerokernels import flow


@pytest.mark.parametrize(
    ("celsius", "kilopascal", "expected"),
    [(20, 80, 21458.0), (20, 100, 26824.4), (20, 120, 32191.6), (10, 100, 27774.7), (30, 100, 25937.2)],
)
def test_dry_air_of_the_paper(celsius, kilopascal, expected):
    """Ciddor (1996), Table 1: 1e8 (n - 1) of dry air, 633 nm, 450 ppm CO2; to the table's digits, 0.05e-8."""
    found = flow.ciddor_refractivity(633e-9, celsius + 273.15, kilopascal * 1e3)
    assert abs(1e8 * found - expected) < 0.06


@pytest.mark.parametrize(
    ("celsius", "pascal", "vapour", "ppm", "expected"),
    [
        (19.526, 102094.8, 1065.0, 510.0, 27392.9),
        (19.517, 102096.8, 1065.0, 510.0, 27394.0),
        (19.173, 102993.0, 641.0, 450.0, 27682.4),
        (19.173, 103006.0, 642.0, 440.0, 27685.8),
        (19.188, 102918.8, 706.0, 450.0, 27658.7),
        (19.189, 102927.8, 708.0, 440.0, 27660.8),
        (19.532, 103603.2, 986.0, 600.0, 27802.0),
        (19.534, 103596.2, 962.0, 600.0, 27800.8),
        (19.534, 103599.2, 951.0, 610.0, 27802.2),
    ],
)
def test_moist_air_of_the_paper(celsius, pascal, vapour, ppm, expected):
    """Ciddor (1996), Table 2: 1e8 (n - 1) at 633 nm, given vapour pressures. The enhancement factor is his eq 1.

    Expected within 0.5e-8: one entry, the second, is off by 0.33e-8, the others by the table's rounding.
    """
    enhancement = 1.00062 + 3.14e-8 * pascal + 5.6e-7 * celsius**2
    water = enhancement * vapour / pascal
    constant = flow.ciddor_constant(633e-9, water=water, co2=ppm * 1e-6)
    density = flow.moist_air_density(celsius + 273.15, pascal, water=water, co2=ppm * 1e-6)
    assert abs(1e8 * constant * density - expected) < 0.5


@pytest.mark.parametrize(
    ("celsius", "kilopascal", "humidity", "expected"),
    [
        (20, 80, 0.75, 21394.0),
        (20, 120, 0.75, 32127.8),
        (40, 80, 0.75, 19896.5),
        (40, 120, 0.75, 29941.8),
        (50, 80, 1.0, 19058.4),
        (50, 120, 1.0, 28792.4),
    ],
)
def test_extremes_of_the_paper(celsius, kilopascal, humidity, expected):
    """Ciddor (1996), Table 3: 1e8 (n - 1) at 633 nm by relative humidity; to the table's digits, 0.05e-8."""
    found = flow.ciddor_refractivity(633e-9, celsius + 273.15, kilopascal * 1e3, humidity=humidity)
    assert abs(1e8 * found - expected) < 0.06


@pytest.mark.parametrize(
    ("celsius", "percent", "kilopascal", "nanometre", "index"),
    [
        (20, 0, 101.325, 633, 1.000271800),
        (20, 0, 60, 633, 1.000160924),
        (20, 0, 120, 633, 1.000321916),
        (50, 0, 100, 633, 1.000243285),
        (5, 0, 100, 633, 1.000282756),
        (-40, 0, 100, 633, 1.000337580),
        (50, 100, 120, 633, 1.000287924),
        (40, 75, 120, 633, 1.000299418),
        (20, 100, 100, 633, 1.000267394),
        (40, 100, 110, 300, 1.000289000),
        (20, 0, 101.325, 300, 1.000286581),
        (-40, 0, 120, 300, 1.000427233),
    ],
)
def test_nist_values(celsius, percent, kilopascal, nanometre, index):
    """NIST Engineering Metrology Toolbox (Stone and Zimmerman), index by the Ciddor equation, 450 ppm CO2: 1e-9.

    NIST takes another formula for the vapour pressure of saturation, which shows in the tenth digit.
    """
    found = flow.ciddor_refractivity(nanometre * 1e-9, celsius + 273.15, kilopascal * 1e3, humidity=percent / 100.0)
    assert abs(1.0 + found - index) < 1e-9


@pytest.mark.parametrize("wavelength", [0.29e-6, 1.7e-6, 10.6e-6])
def test_wavelengths_out_of_range_are_refused(wavelength):
    with pytest.raises(ValueError, match=r"outside Ciddor's 0\.3 to 1\.69 um: choose another relation"):
        flow.ciddor_constant(wavelength)


def test_bad_air_is_refused():
    with pytest.raises(ValueError, match=r"humidity must be between 0 and 1, got 50"):
        flow.ciddor_refractivity(905e-9, 293.15, 1e5, humidity=50)
    with pytest.raises(ValueError, match="needs a vapour pressure above 1000 Pa"):
        flow.water_fraction(300.0, 1e3, 1.0)
    with pytest.raises(ValueError, match=r"carbon dioxide must be between 0 and 0\.002, got 450"):
        flow.ciddor_constant(905e-9, co2=450)
    assert flow.ciddor_constant(905e-9, co2=0.0) < flow.ciddor_constant(905e-9)  # air without any is some
    with pytest.raises(ValueError, match="water vapour must be between 0 and 1"):
        flow.moist_air_density(293.15, 1e5, water=-0.1)
    with pytest.raises(ValueError, match="temperature must be positive"):
        flow.moist_air_density(-3.0, 1e5)
    with pytest.raises(ValueError, match="pressure must be positive"):
        flow.water_fraction(293.15, 0.0, 0.5)


@pytest.mark.parametrize(("temperature", "pressure"), [(1500.0, 1e5), (100.0, 1e5), (293.15, 1e8)])
def test_extrapolated_densities_are_told(temperature, pressure):
    with pytest.warns(UserWarning, match="is extrapolated: its compressibility is known from 233 to 373"):
        flow.ciddor_refractivity(905e-9, temperature, pressure)
