"""Numbers with their errors in words, and the verdict on a Strehl ratio."""

import math

import pytest

from aerokernels.display.quantities import Quantity, judge_strehl, listed


@pytest.mark.parametrize(
    ("value", "error", "unit", "text"),
    [
        (0.97786, 0.004078, "", "0.978 +- 0.004"),
        (0.97786, 0.0029, "", "0.9779 +- 0.0029"),
        (0.30763487, 2.038, "", "0.3 +- 2.0"),
        (1.0, 0.00996, "", "1.000 +- 0.010"),
        (1.5, 0.0296, "m", "1.50 +- 0.03 m"),
        (1234.0, 310.0, "m", "1200 +- 300 m"),
        (0.0, 0.003, "", "0.000 +- 0.003"),
        (-0.0001, 0.003, "", "0.000 +- 0.003"),
        (2.15e-8, 6.6e-10, "m", "(2.15 +- 0.07)e-08 m"),
        (3e-9, 5e-8, "rad", "(0 +- 5)e-08 rad"),
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
@pytest.mark.parametrize("value", [0.0, -0.977859, 1.0, 37.25])
def test_value_and_error_end_at_the_same_place_and_lose_little(value, error):
    """Expected: value and error end at one place, which costs both 17 % of the error at most (3.5 written as 3).

    The error has two significant digits at most, one where the first is 3 or more.
    """
    text = str(Quantity(value, error))
    inner, _, power = text.strip("(").partition(")e")
    scale = 10.0 ** int(power or 0)
    number, spread = inner.split(" +- ")
    assert len(number.partition(".")[2]) == len(spread.partition(".")[2])
    assert float(spread) * scale == pytest.approx(error, rel=0.17)
    assert abs(float(number) * scale - value) <= 0.17 * error + 1e-9
    digits = spread.replace(".", "").strip("0")
    assert len(digits) <= (2 if int(digits[0]) < 3 else 1), text


@pytest.mark.parametrize(
    ("value", "error", "limited", "text"),
    [
        (2e-9, 43000.0, 1.0, "2e-09, not meaningful: its error allows any ratio from 0 to 1"),
        (0.7, math.inf, 0.7, "0.7, not meaningful: its error allows any ratio from 0 to 1"),
        (0.3, 0.72, 0.7, "0.3, not meaningful: its error allows any ratio from 0 to 1"),
        (0.3, 0.5, 0.5, "0.3 +- 0.5"),
        (0.978, 0.004, 0.004, "0.978 +- 0.004"),
        (0.5, math.nan, math.nan, "0.5, error not known"),
        (1.0, 0.0, 0.0, "1, error below rounding"),
    ],
)
def test_a_ratio_has_no_greater_error_than_its_bounds_allow(value, error, limited, text):
    """A Strehl ratio of a bad field was reported as 0 +- 43000. Its error is at most max(S, 1 - S)."""
    ratio = Quantity(value, error, is_ratio=True)
    assert ratio.error == pytest.approx(limited, nan_ok=True) and str(ratio) == text
    assert str(ratio.scaled(1.0, "")) == text
    assert judge_strehl(ratio).worthless == (not error < value)


def test_a_sign_and_another_unit():
    assert Quantity(0.0126, 0.0023, "m").scaled(1e3, "mm").text(signed=True) == "+12.6 +- 2.3 mm"
    assert Quantity(-0.0126, 0.0023, "m").scaled(-1e3, "mm").text(signed=True) == "+12.6 +- 2.3 mm"
    assert Quantity(0.0, 0.3).text(signed=True) == "0.0 +- 0.3"
    assert (
        listed([Quantity(4.0, 0.14, "urad"), Quantity(-2.0, 0.14, "urad")], True) == "+4.00 +- 0.14, -2.00 +- 0.14 urad"
    )
    assert listed([Quantity(0.0, 0.0, "urad")] * 2) == "0, 0 urad, error below rounding"
    with pytest.raises(ValueError, match="not negative"):
        Quantity(1.0, -0.1)


@pytest.mark.parametrize(
    ("value", "error", "level", "words"),
    [
        (0.978, 0.004, "fine", ""),
        (0.978, 0.03, "warning", "effect of the flow"),
        (0.6, 0.12, "warning", "a tenth of 1"),
        (0.31, 0.32, "worthless", "the ratio itself"),
        (0.999, 1.5, "worthless", "any ratio from 0 to 1"),
        (2e-9, 43000.0, "worthless", "any ratio from 0 to 1"),
        (0.978, math.nan, "worthless", "not known"),
        (math.nan, 0.1, "worthless", "not known"),
        (1.0, 1e-9, "fine", ""),  # nothing disturbs, and so it says
        (1.0, 1e-3, "warning", "effect of the flow"),
    ],
)
def test_the_verdict_on_a_strehl_ratio(value, error, level, words):
    verdict = judge_strehl(Quantity(value, error), "the remedy")
    assert verdict.level == level and words in verdict.reason
    assert verdict.worthless == (level == "worthless") and bool(verdict) == (level != "fine")
    assert verdict.reason.endswith("the remedy") == bool(verdict)
