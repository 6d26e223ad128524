"""Units as files write them: factors to SI, in many spellings, and what is none."""

import pytest

from aerokernels.inputs.units import in_brackets, ratio_of, unit_of, written_unit


@pytest.mark.parametrize(
    ("text", "dimension", "factor", "offset"),
    [
        ("kg m-3", "density", 1.0, 0.0),
        ("kilogram / meter ** 3", "density", 1.0, 0.0),
        ("kg/(m^3)", "density", 1.0, 0.0),
        ("kg·m⁻³", "density", 1.0, 0.0),
        ("g cm-3", "density", 1000.0, 0.0),
        ("g/L", "density", 1.0, 0.0),
        ("slug/ft3", "density", 515.37882, 0.0),
        ("Kg/m3", "density", 1.0, 0.0),
        ("hPa", "pressure", 100.0, 0.0),
        ("millibar", "pressure", 100.0, 0.0),
        ("psi", "pressure", 6894.757, 0.0),
        ("N m-2", "pressure", 1.0, 0.0),
        ("kg^1 m^-1 s^-2", "pressure", 1.0, 0.0),
        ("°C", "temperature", 1.0, 273.15),
        ("degree_Celsius", "temperature", 1.0, 273.15),
        ("degR", "temperature", 5.0 / 9.0, 0.0),
        ("mm", "length", 1e-3, 0.0),
        ("millimeters", "length", 1e-3, 0.0),
        ("µm", "length", 1e-6, 0.0),
        ("microns", "length", 1e-6, 0.0),
        ("inches", "length", 0.0254, 0.0),
        ("ms", "time", 1e-3, 0.0),
        ("1", "length", 1.0, 0.0),
        ("", "density", 1.0, 0.0),
    ],
)
def test_units_that_programs_write(text, dimension, factor, offset):
    found = unit_of(text, dimension)
    assert found.factor == pytest.approx(factor, rel=1e-7) and found.offset == offset


def test_thousands_are_exact():
    assert unit_of("g/cm3", "density").factor == 1000.0 and unit_of("mm", "length").factor == 1e-3


@pytest.mark.parametrize(
    ("text", "dimension"), [("kg", "length"), ("m^2 s^-2", "pressure"), ("code_length", "length"), ("m(", "length")]
)
def test_what_is_no_such_unit_is_refused(text, dimension):
    with pytest.raises(ValueError, match=f"no unit of a {dimension}"):
        unit_of(text, dimension)


def test_units_in_names():
    assert [in_brackets(name) for name in ("x [mm]", "p(kPa)", "rho (kg/(m^3))", "T", "Points:0")] == [
        "mm", "kPa", "kg/(m^3)", "", "",
    ]  # fmt: skip
    assert written_unit("axial") is None


@pytest.mark.parametrize("text", ["ppm", "1e-6", "1.0E-06", "10^-6", "10**-6", "1 x 10^-6", "1 × 10⁻⁶", "10-6"])
def test_millionths_as_they_are_written(text):
    assert ratio_of(text) == 1e-6


@pytest.mark.parametrize("text", ["2e-6", "kg/m3", "m", "1e6", "10", "1e-6 m", "e", "1" * 300])
def test_what_is_no_unit_of_a_ratio_is_refused(text):
    with pytest.raises(ValueError, match="is no unit of a ratio that is known"):
        ratio_of(text)
