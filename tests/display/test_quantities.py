"""Numbers with their errors in words."""

import math

import pytest

from aerokernels.display.quantities import Quantity, listed


@pytest.mark.parametrize(
    ("value", "error", "unit", "text"),
    [
        (0.97786, 0.004078, "", "0.9779 +- 0.0041"),
        (13.8, 2100.0, "V", "13.8 +- 2100 V"),
        (0.30763487, 2.038, "", "0.308 +- 2.0"),
        (1.0, 0.00996, "", "1.000 +- 0.010"),
        (1234.0, 310.0, "m", "1230 +- 310 m"),
        (0.0, 0.003, "", "0.0000 +- 0.0030"),
        (-0.0001, 0.003, "", "-0.000100 +- 0.0030"),
        (2.15e-8, 6.6e-10, "m", "(2.150 +- 0.066)e-08 m"),
        (3e-9, 5e-8, "rad", "(0.300 +- 5.0)e-08 rad"),
        (1e-20, 0.003, "", "1e-20 +- 0.003"),
        (123456789.0, 20000.0, "", "(1.23457 +- 0.00020)e+08"),
        (1.0, 1.2e-10, "", "1.00000000 +- 1.2e-10"),
        (4096, None, "", "4096"),
        (0.5, math.nan, "W", "0.5 W, error not known"),
        (0.5, math.inf, "", "0.5, error without bound"),
        (0.0, 0.0, "rad", "0 rad, error below rounding"),
        (math.nan, 0.1, "m", "none"),
    ],
)
def test_a_quantity_is_rounded_to_its_error(value, error, unit, text):
    assert str(Quantity(value, error, unit)) == text


@pytest.mark.parametrize("error", [1.1e-6 * 1.37**k for k in range(52)])
@pytest.mark.parametrize("value", [-0.977859, 1.0, 37.25, 999.96])
def test_value_and_error_keep_their_digits(value, error):
    """Expected: the value within half a percent and a twentieth of the error, and two digits of the error."""
    inner, _, power = str(Quantity(value, error)).strip("(").partition(")e")
    scale = 10.0 ** int(power or 0)
    number, spread = inner.split(" +- ")
    assert float(number) * scale == pytest.approx(value, rel=5e-3, abs=0.05 * error + 1e-9 * abs(value))
    assert float(number) * scale == pytest.approx(value, rel=5e-3)
    assert float(spread) * scale == pytest.approx(error, rel=0.05)


@pytest.mark.parametrize(
    ("value", "error", "limited", "text"),
    [
        (2e-9, 43000.0, 1.0, "2e-09, not meaningful: its error allows any ratio from 0 to 1"),
        (0.7, math.inf, 0.7, "0.7, not meaningful: its error allows any ratio from 0 to 1"),
        (0.3, 0.72, 0.7, "0.3, not meaningful: its error allows any ratio from 0 to 1"),
        (0.3, 0.5, 0.5, "0.300 (0 to 0.800)"),
        (0.999, 0.011, 0.011, "0.999 (0.988 to 1)"),
        (1.0 + 1e-12, 1e-3, 1e-3, "1.0000 (0.9990 to 1)"),
        (2e-9, 1e-5, 1e-5, "2e-09 (0 to 1e-05)"),
        (0.978, 0.004, 0.004, "0.9780 +- 0.0040"),
        (0.5, math.nan, math.nan, "0.5, error not known"),
        (1.0, 0.0, 0.0, "1, error below rounding"),
    ],
)
def test_a_ratio_and_its_interval_are_within_0_and_1(value, error, limited, text):
    ratio = Quantity(value, error, is_ratio=True)
    assert ratio.error == pytest.approx(limited, nan_ok=True) and str(ratio) == text
    assert str(ratio.scaled(1.0, "")) == text
    if not math.isnan(error):
        low, high = ratio.interval
        assert 0.0 <= low <= ratio.value <= high <= 1.0


def test_a_sign_and_another_unit():
    assert Quantity(0.0126, 0.0023, "m").scaled(1e3, "mm").text(signed=True) == "+12.6 +- 2.3 mm"
    assert Quantity(-0.0126, 0.0023, "m").scaled(-1e3, "mm").text(signed=True) == "+12.6 +- 2.3 mm"
    assert Quantity(0.0, 0.3).text(signed=True) == "0.00 +- 0.30"
    assert (
        listed([Quantity(4.0, 0.14, "urad"), Quantity(-2.0, 0.14, "urad")], True) == "+4.00 +- 0.14, -2.00 +- 0.14 urad"
    )
    assert listed([Quantity(0.0, 0.0, "urad")] * 2) == "0, 0 urad, error below rounding"
    with pytest.raises(ValueError, match="not negative"):
        Quantity(1.0, -0.1)
