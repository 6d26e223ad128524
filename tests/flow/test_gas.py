"""Perfect-gas relations and the tunnel's free stream."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerokernels import flow

MACH = st.floats(0.01, 20.0)
GAMMA = st.floats(1.05, 1.67)


@pytest.mark.parametrize(
    ("mach", "megapascal", "density", "published"),
    [(2.0, 0.19, 0.5287, 0.51), (3.0, 0.36, 0.3319, 0.33), (4.0, 0.63, 0.2108, 0.20)],
)
def test_table_2(mach, megapascal, density, published):
    """Set-up: the paper's Table 2, T0 288 K. Formula: isentropic expansion of a perfect gas.

    Expected: the densities worked out by hand, given to 4 digits, so the tolerance is half of the last one; the paper's
    own are 3.5, 0.6 and 5.1 % lower, to its two digits.
    """
    stream = flow.tunnel_conditions(mach, megapascal * 1e6, 288.0)
    assert abs(stream.density - density) < 0.5e-4
    below = {2.0: 0.035, 3.0: 0.006, 4.0: 0.051}[mach]
    assert abs(1.0 - published / stream.density - below) < 0.0005


def test_isentropic_closed_forms():
    """Mach 2 and 3 of air are rational: T/T0 = 1/1.8 and 1/2.8, p/p0 = (T/T0)^3.5, rho/rho0 = (T/T0)^2.5."""
    for mach, temperature in ((2.0, 1.8), (3.0, 2.8)):
        ratio = flow.isentropic(mach)
        assert abs(ratio.temperature_ratio * temperature - 1.0) < 1e-15
        assert abs(ratio.pressure_ratio * temperature**3.5 - 1.0) < 1e-14
        assert abs(ratio.density_ratio * temperature**2.5 - 1.0) < 1e-14


@given(MACH, st.floats(1e3, 1e8), st.floats(50.0, 3000.0), GAMMA, st.floats(50.0, 5000.0))
def test_total_enthalpy_entropy_and_gas_law(mach, pressure, temperature, gamma, gas_constant):
    """Cp T + u^2/2 = cp T0, p / rho^gamma is the reservoir's, p = rho R T; rounding only."""
    stream = flow.tunnel_conditions(mach, pressure, temperature, gamma=gamma, gas_constant=gas_constant)
    heat = gamma / (gamma - 1.0) * gas_constant
    total = heat * stream.temperature + 0.5 * stream.velocity**2
    assert abs(total / (heat * temperature) - 1.0) < 1e-13
    assert abs(stream.pressure / (stream.density * gas_constant * stream.temperature) - 1.0) < 1e-14
    reservoir = pressure / (gas_constant * temperature)
    # Logarithms, because the powers of a Mach 20 expansion span many decades; their rounding is a few 1e-15 of ~30.
    entropy = math.log(stream.pressure / pressure) - gamma * math.log(stream.density / reservoir)
    assert abs(entropy) < 1e-12
    assert abs(stream.velocity / stream.sound_speed / mach - 1.0) < 1e-14


def test_published_density_as_an_override():
    """The paper's 0.51 kg/m3 replaces the isentropic one; motion stays, pressures follow the gas law."""
    own, published = (flow.tunnel_conditions(2.0, 0.19e6, 288.0, density=rho) for rho in (None, 0.51))
    assert published.density == 0.51
    assert (published.temperature, published.velocity, published.mach) == (own.temperature, own.velocity, own.mach)
    expected = 0.51 * published.gas_constant * published.temperature
    assert abs(published.pressure / expected - 1.0) < 1e-14
    assert abs(published.stagnation_pressure / own.stagnation_pressure - 0.51 / own.density) < 1e-14


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"mach": 0.0}, "mach"),
        ({"mach": math.nan}, "mach"),
        ({"stagnation_pressure": -1.0}, "stagnation_pressure"),
        ({"stagnation_temperature": 0.0}, "stagnation_temperature"),
        ({"gas_constant": math.inf}, "gas_constant"),
        ({"gamma": 1.0}, "gamma"),
        ({"density": 0.0}, "density"),
    ],
)
def test_bad_conditions_are_refused_by_name(arguments, words):
    good = {"mach": 2.0, "stagnation_pressure": 1e5, "stagnation_temperature": 288.0}
    with pytest.raises(ValueError, match=words):
        flow.tunnel_conditions(**(good | arguments))
