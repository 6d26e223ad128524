"""Judge whether an answer is meaningful given its errors; no other code does."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from .quantities import Quantity

# Error of a Strehl ratio above which there is always a warning; and effect below which the flow counts as having none.
GREAT_ERROR, NO_EFFECT = 0.1, 1e-6

FINE, WARNING, WORTHLESS = "fine", "warning", "worthless"
LEVELS = (FINE, WARNING, WORTHLESS)


@dataclass(frozen=True)
class Verdict:
    """Whether a number is meaningful given its error.

    Attributes:
        level: "fine"; "warning": read the number with its error in mind; "worthless": the number is not meaningful.
        reason: Why, in one sentence; empty if the level is "fine".
    """

    level: str = FINE
    reason: str = ""

    @property
    def worthless(self) -> bool:
        """Whether the number is not meaningful."""
        return self.level == WORTHLESS

    def __bool__(self) -> bool:
        """Return whether there is a warning or worse."""
        return self.level != FINE


def judge(numbers: Mapping[str, Quantity], main_cause: str = "") -> Verdict:
    """Return the verdict on an answer: the worst of those on its main numbers, the first of equals.

    Worthless is a ratio whose error allows anything from 0 to 1, another number whose error is greater than itself, and
    a number that there is not. A warning: an error that is not known; of a ratio an error above a tenth of 1, above the
    ratio itself, or above the effect 1 - ratio, so that the flow may have no effect. An effect below 1e-6 counts as
    none, and an error of that size gives no warning.

    Args:
        numbers: The numbers by what they are called, such as "Strehl ratio".
        main_cause: The main cause of the errors, with the remedy, in words.
    """
    found = [(*_judged(number), name) for name, number in numbers.items()]
    level, why, name = max(found, key=lambda one: LEVELS.index(one[0]))
    cause = f"; {main_cause}" if main_cause else ""
    return Verdict() if level == FINE else Verdict(level, f"the {name}{why}{cause}")


def _judged(number: Quantity) -> tuple[str, str]:
    """Return the level of a number, and why, to follow its name."""
    value, error = number.value, number.error
    if math.isnan(value):
        return WORTHLESS, " has no value"
    if error is None:
        return FINE, ""
    if math.isnan(error):
        return WARNING, "'s error is not known"
    if number.allows_any_ratio:
        return WORTHLESS, "'s error allows any ratio from 0 to 1: the number is not meaningful"
    told = f"'s error, {error:.2g}, is greater than"
    if not number.is_ratio:
        return (WORTHLESS, f"{told} the number itself, {value:.3g}") if error > abs(value) else (FINE, "")
    if error > value:
        return WARNING, f"{told} the ratio itself, {value:.3g}"
    if error > max(1.0 - value, NO_EFFECT):
        return WARNING, f"{told} the effect of the flow, which reduces the ratio by {1.0 - value:.2g}"
    return (WARNING, f"{told} a tenth of 1") if error > GREAT_ERROR else (FINE, "")
