"""Whether an answer is meaningful given its errors: one rule for all commands."""

import math

import pytest

from aerokernels.display.quantities import Quantity, judge


@pytest.mark.parametrize(
    ("value", "error", "level", "words"),
    [
        (0.978, 0.004, "fine", ""),
        (0.978, 0.03, "warning", "effect of the flow"),
        (0.6, 0.12, "warning", "a tenth of 1"),
        (0.31, 0.32, "warning", "the ratio itself"),  # below 0.63 is an answer
        (0.02, 0.03, "warning", "the ratio itself"),
        (0.999, 1.5, "worthless", "any ratio from 0 to 1"),
        (2e-9, 43000.0, "worthless", "any ratio from 0 to 1"),
        (0.978, math.inf, "worthless", "any ratio from 0 to 1"),
        (0.978, math.nan, "warning", "not known"),
        (math.nan, 0.1, "worthless", "no value"),
        (1.0, 1e-9, "fine", ""),  # nothing disturbs, and so it says
        (1.0, 1e-3, "warning", "effect of the flow"),
    ],
)
def test_the_verdict_on_a_strehl_ratio(value, error, level, words):
    verdict = judge({"Strehl ratio": Quantity(value, error, is_ratio=True)}, "the remedy")
    assert verdict.level == level and words in verdict.reason
    assert verdict.worthless == (level == "worthless") and bool(verdict) == (level != "fine")
    assert verdict.reason.endswith("the remedy") == bool(verdict)


def test_the_worst_number_decides():
    good, poor = Quantity(0.6, 0.12, is_ratio=True), Quantity(1e-6, 2e-6, "W")
    verdict = judge({"Strehl ratio": good, "echo's peak": poor})
    assert verdict.worthless and verdict.reason.startswith("the echo's peak's error, 2e-06, is greater than")
    assert judge({"Strehl ratio": good, "echo's peak": Quantity(1e-6, 9e-7, "W")}).level == "warning"
    assert not judge({"echo's peak": Quantity(0.0, 0.0, "W")})
