"""Format a number with its error (digits beyond the error are dropped), and judge if it is meaningful given the error.

    0.978 +- 0.004        the error has one digit if that is 3 or more, else two; the value ends where the error ends
    (2.15 +- 0.12)e-08    one power of ten for both, if plain digits would need many zeros
    0.978, error not known
    1, error below rounding
    0, not meaningful: its error allows any ratio from 0 to 1

An error is the greatest deviation from the exact answer that the measured causes can make: the root sum of squares of
all of them. It is not a standard deviation unless its source says so.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

# Significant digits of a value without a usable error, and the most that any value is written with.
PLAIN_DIGITS, MOST_DIGITS = 6, 9
# Powers of ten beyond which value and error are written with a common power.
LEAST_POWER, GREATEST_POWER = -4, 6
# Error of a Strehl ratio above which there is always a warning; and effect below which the flow counts as having none.
GREAT_ERROR, NO_EFFECT = 0.1, 1e-6

FINE, WARNING, WORTHLESS = "fine", "warning", "worthless"


@dataclass(frozen=True)
class Quantity:
    """A number, its error and its unit.

    Attributes:
        value: The number; NaN if there is none.
        error: Its error, in the same unit; NaN: not known; infinite: without bound; 0: below rounding; None: the
            number is no estimate (a count, a setting) and has no error.
        unit: Unit of both, as it is written.
        is_ratio: The number is between 0 and 1: a greater error than these bounds allow is reduced to
            max(value, 1 - value), and the number is not meaningful.
    """

    value: float
    error: float | None = math.nan
    unit: str = ""
    is_ratio: bool = False

    def __post_init__(self) -> None:
        """Check the error, and limit that of a ratio.

        Raises:
            ValueError: A negative error.
        """
        if self.error is not None and self.error < 0.0:
            raise ValueError(f"an error is not negative, got {self.error!r} for the value {self.value!r}")
        if self.allows_any_ratio:
            object.__setattr__(self, "error", greatest_ratio_error(self.value))

    @property
    def allows_any_ratio(self) -> bool:
        """Whether the number is a ratio whose error is as great as the bounds 0 and 1 allow."""
        return self.is_ratio and self.error is not None and self.error >= greatest_ratio_error(self.value)

    def scaled(self, factor: float, unit: str) -> "Quantity":
        """Return the quantity in another unit: value and error times `factor`."""
        error = None if self.error is None else abs(factor) * self.error
        return Quantity(factor * self.value, error, unit, self.is_ratio and factor == 1.0)

    def text(self, signed: bool = False) -> str:
        """Return the quantity as text; `signed` writes the plus of a positive value too."""
        unit = f" {self.unit}" if self.unit else ""
        if math.isnan(self.value):
            return "none"
        sign = "+" if signed and self.value else ""
        text = f"{self.value:{sign}.{PLAIN_DIGITS}g}{unit}"
        if self.error is None:
            return text
        if math.isnan(self.error):
            return f"{text}, error not known"
        if math.isinf(self.error) or math.isinf(self.value):
            return f"{text}, error without bound"
        if self.allows_any_ratio:
            return f"{self.value:{sign}.2g}{unit}, not meaningful: its error allows any ratio from 0 to 1"
        if self.error == 0.0:
            return f"{text}, error below rounding"
        return _joined(self.value, self.error, sign, self.unit)

    def __str__(self) -> str:
        """Return the quantity as text."""
        return self.text()


def greatest_ratio_error(value: float) -> float:
    """Return the greatest error of a number between 0 and 1 that is `value`."""
    return max(value, 1.0 - value)


def listed(quantities: Sequence[Quantity], signed: bool = False) -> str:
    """Return quantities of one unit in a row, with the unit once: "+4.00 +- 0.14, +2.00 +- 0.14 urad"."""
    unit = quantities[0].unit
    if all(one.error is not None and 0.0 < one.error < math.inf for one in quantities):
        return ", ".join(replace(one, unit="").text(signed) for one in quantities) + (f" {unit}" if unit else "")
    words = [one.text(signed) for one in quantities]
    ends = {text.partition(", ")[2] for text in words}
    if len(ends) == 1 and (end := ends.pop()):
        numbers = ", ".join(replace(one, unit="", error=None).text(signed) for one in quantities)
        return f"{numbers}{f' {unit}' if unit else ''}, {end}"
    return "; ".join(words)


def _joined(value: float, error: float, sign: str, unit: str) -> str:
    """Return value and error, both to the same decimal place."""
    last = last_place(error)
    top = max(_power(value), _power(error))
    least = top - MOST_DIGITS + 1
    small = f"{error:.2g}" if last < least else None  # an error smaller than the last digit of the value
    last = max(last, least)
    after = f" {unit}" if unit else ""
    if LEAST_POWER < top < GREATEST_POWER:
        places = max(-last, 0)
        rounded = round(value, -last) + 0.0  # no negative zero
        text = f"{rounded:{sign if rounded else ''}.{places}f} +- {small or f'{round(error, -last):.{places}f}'}"
        return f"{text}{after}"
    scale, places = 10.0**top, max(top - last, 0)
    text = f"{round(value / scale, places) + 0.0:{sign}.{places}f}"
    if small is not None:
        return f"{text}e{top:+03d} +- {small}{after}"
    return f"({text} +- {error / scale:.{places}f})e{top:+03d}{after}"


def last_place(error: float) -> int:
    """Return the power of ten of an error's last shown digit: the first digit if that is 3 or more, else the second."""
    power = _power(error)
    return power - 1 if error / 10.0**power < 2.95 else power  # 2.95 rounds up to 3


def _power(number: float) -> int:
    return math.floor(math.log10(abs(number))) if number else -400


def root_sum_square(errors: Iterable[float]) -> float:
    """Return the error of a number from the errors of independent causes."""
    return math.sqrt(sum(error * error for error in errors))


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


def judge_strehl(ratio: Quantity, main_cause: str = "") -> Verdict:
    """Return the verdict on a Strehl ratio; no other code makes one.

    Worthless: an error that is not known, that allows any ratio from 0 to 1, or that is above the ratio itself.
    A warning: an error above a tenth of 1, or above the effect 1 - ratio, so that the flow may have no effect.
    An effect below 1e-6 counts as none, and an error of that size gives no warning.

    Args:
        ratio: The Strehl ratio.
        main_cause: The main cause of the error, with the remedy, in words.
    """
    value, error = ratio.value, ratio.error
    effect, cause = 1.0 - value, f"; {main_cause}" if main_cause else ""
    if error is None or math.isnan(value) or not math.isfinite(error):
        return Verdict(WORTHLESS, f"the Strehl ratio's error is not known, so the number is not meaningful{cause}")
    if error >= greatest_ratio_error(value):
        reason = "the Strehl ratio's error allows any ratio from 0 to 1: the number is not meaningful"
        return Verdict(WORTHLESS, f"{reason}{cause}")
    if error > value:
        level, bound = WORTHLESS, f"the ratio itself, {value:.2g}: the number is not meaningful"
    elif error > max(effect, NO_EFFECT):
        level, bound = WARNING, f"the effect of the flow, which reduces the ratio by {effect:.2g}"
    elif error > GREAT_ERROR:
        level, bound = WARNING, "a tenth of 1"
    else:
        return Verdict()
    return Verdict(level, f"the Strehl ratio's error, {error:.2g}, is greater than {bound}{cause}")
