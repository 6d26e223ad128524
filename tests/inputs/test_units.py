"""Quantities with units."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerokernels.inputs.units import DIMENSIONS, quantity


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("905 nm", "length", 905e-9),
        ("905nm", "length", 905e-9),
        (" 1.5 m ", "length", 1.5),
        ("-8 mm", "length", -8e-3),
        ("2 µm", "length", 2e-6),
        ("2 μm", "length", 2e-6),
        ("1e3 km", "length", 1e6),
        (".5 m", "length", 0.5),
        ("75 W", "power", 75.0),
        ("6 ns", "time", 6e-9),
        ("10 deg", "angle", math.pi / 18),
        ("10°", "angle", math.pi / 18),
        ("0.63 MPa", "pressure", 0.63e6),
        ("1 atm", "pressure", 101325.0),
        ("15 degC", "temperature", 288.15),
        ("15 °C", "temperature", 288.15),
        ("288 K", "temperature", 288.0),
        ("1.225 kg/m3", "density", 1.225),
        ("1.225 kg/m^3", "density", 1.225),
        ("1.225 kg/m³", "density", 1.225),
        ("1.2 g/L", "density", 1.2),
        ("1 GHz", "frequency", 1e9),
        ("250 mV", "voltage", 0.25),
        ("2 V/mW", "responsivity", 2e3),
        ("5 nA", "current", 5e-9),
        ("550 mA/W", "photodiode responsivity", 0.55),
        ("2 pA/√Hz", "noise current density", 2e-12),
        ("2 pA/sqrt(Hz)", "noise current density", 2e-12),
        ("1.2 kΩ", "resistance", 1200.0),
        ("50 ohm", "resistance", 50.0),
        ("0.225 cm3/g", "gladstone-dale", 2.25e-4),
        ("30 %", "dimensionless", 0.3),
        ("0.3", "dimensionless", 0.3),
        ("1.5", "length", 1.5),
        (2, "length", 2.0),
        (0.25, "time", 0.25),
    ],
)
def test_quantities(text, dimension, value):
    assert quantity(text, dimension) == pytest.approx(value, rel=1e-15, abs=0.0)


def test_decimal_prefixes_are_exact():
    """The text "6 ns" is the float 6e-9: 6 * 1e-9 would be its neighbour."""
    assert quantity("6 ns", "time") == 6e-9 != 6 * 1e-9


@pytest.mark.parametrize(
    ("text", "dimension", "words"),
    [
        ("1.5 kg", "length", ["'1.5 kg'", "not a known unit", "nm, um, mm"]),
        ("5 ns", "length", ["'5 ns'", "measures a time", "bare number is in m"]),
        ("5 NM", "length", ["did you mean nm?"]),
        ("five metres", "length", ["'five metres'"]),
        ("", "length", ["''"]),
        ("m", "length", ["'m'"]),
        ("1,5 m", "length", ["'1,5 m'"]),
        ("1 2 m", "length", ["'1 2 m'"]),
        ("30 %", "length", ["a plain number"]),
        ("3 m", "dimensionless", ["measures a length", "'30 %'"]),
        ("1e400 m", "length", ["finite"]),
        ("1e99999999999999999999 m", "length", ["finite"]),
        (math.nan, "length", ["finite"]),
        (math.inf, "time", ["finite"]),
        ("nan m", "length", ["'nan m'"]),
    ],
)
def test_refusals_name_the_value_and_what_is_accepted(text, dimension, words):
    with pytest.raises(ValueError) as fault:
        quantity(text, dimension)
    for word in words:
        assert word in str(fault.value)


@pytest.mark.parametrize("value", [True, None, [1.0], {"m": 1}])
def test_other_types_are_refused(value):
    with pytest.raises(TypeError, match="is not a length"):
        quantity(value, "length")


@given(st.text(max_size=20), st.sampled_from(DIMENSIONS))
def test_any_text_gives_a_finite_number_or_a_value_error(text, dimension):
    try:
        assert math.isfinite(quantity(text, dimension))
    except ValueError as fault:
        assert repr(text) in str(fault)
