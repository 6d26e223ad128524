"""A number with its error, written so that no digit stands beyond the error, and what an error makes of its number.

    0.978 +- 0.004        the error has one digit where that is 3 or more, else two; the value ends where the error ends
    (2.15 +- 0.12)e-08    one power of ten for both, where plain digits would be zeros
    0.978, error not known
    1, error below rounding

An error is the greatest deviation from the exact answer that the causes measured can make, root sum of squares of all
of them; it is no standard deviation unless its source says so.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

# Significant digits of a value whose error says nothing, and the most that any value is written with.
PLAIN_DIGITS, MOST_DIGITS = 6, 9
# Powers of ten at which plain digits give way to a common power.
LEAST_POWER, GREATEST_POWER = -4, 6
# A Strehl ratio's error that is a warning, whatever the ratio; and an effect of which no sign can be asked.
GREAT_ERROR, NO_EFFECT = 0.1, 1e-6

FINE, WARNING, WORTHLESS = "fine", "warning", "worthless"


@dataclass(frozen=True)
class Quantity:
    """A number, its error and its unit.

    Attributes:
        value: The number; NaN where there is none.
        error: What it may be off by, of the same unit; NaN: not known; infinite: without bound; 0: below rounding;
            None: the number is no estimate (a count, a setting) and has none.
        unit: Unit of both, as it is to be written.
    """

    value: float
    error: float | None = math.nan
    unit: str = ""

    def __post_init__(self) -> None:
        """Check.

        Raises:
            ValueError: A negative error.
        """
        if self.error is not None and self.error < 0.0:
            raise ValueError(f"an error is not negative, got {self.error!r} for the value {self.value!r}")

    def scaled(self, factor: float, unit: str) -> "Quantity":
        """The same in another unit: value and error times `factor`."""
        error = None if self.error is None else abs(factor) * self.error
        return Quantity(factor * self.value, error, unit)

    def text(self, signed: bool = False) -> str:
        """The quantity in words; `signed` writes the plus of a positive value too."""
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
        if self.error == 0.0:
            return f"{text}, error below rounding"
        return _joined(self.value, self.error, sign, self.unit)

    def __str__(self) -> str:
        """The quantity in words."""
        return self.text()


def listed(quantities: Sequence[Quantity], signed: bool = False) -> str:
    """Quantities of one unit in a row, the unit once: "+4.00 +- 0.14, +2.00 +- 0.14 urad"."""
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
    """Value and error to the same decimal place."""
    last = last_place(error)
    top = max(_power(value), _power(error))
    least = top - MOST_DIGITS + 1
    small = f"{error:.2g}" if last < least else None  # an error beyond the digits that a value is written with
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
    """Power of ten of the last digit that an error leaves: its first from 3 on, its second below, once rounded."""
    power = _power(error)
    return power - 1 if error / 10.0**power < 2.95 else power  # 2.95 rounds up to 3


def _power(number: float) -> int:
    return math.floor(math.log10(abs(number))) if number else -400


def root_sum_square(errors: Iterable[float]) -> float:
    """Error of a number from those of independent causes, as an error budget adds them up."""
    return math.sqrt(sum(error * error for error in errors))


@dataclass(frozen=True)
class Verdict:
    """What an error makes of its number.

    Attributes:
        level: "fine"; "warning": read the number with its error in mind; "worthless": the number answers nothing.
        reason: Why, in one sentence; empty where the level is "fine".
    """

    level: str = FINE
    reason: str = ""

    @property
    def worthless(self) -> bool:
        """Whether the number answers nothing."""
        return self.level == WORTHLESS

    def __bool__(self) -> bool:
        """Whether there is something to say."""
        return self.level != FINE


def judge_strehl(ratio: Quantity, main_cause: str = "") -> Verdict:
    """The verdict on a Strehl ratio, the one place where it is made.

    Worthless: an error that is not known, above 1 (every ratio lies between 0 and 1), or above the ratio itself.
    A warning: an error above a tenth of 1, or above the effect 1 - ratio, so that the flow may have done nothing.
    An effect below 1e-6 is none, and no error is held against it that is as small.

    Args:
        ratio: The Strehl ratio.
        main_cause: What the greatest part of the error comes from, with the remedy, in words.
    """
    value, error = ratio.value, ratio.error
    cause = f"; {main_cause}" if main_cause else ""
    if error is None or math.isnan(value) or not math.isfinite(error):
        return Verdict(WORTHLESS, f"the Strehl ratio's error is not known, so the number answers nothing{cause}")
    if error > 1.0:
        return Verdict(
            WORTHLESS,
            f"the Strehl ratio's error, {error:.2g}, is greater than 1, and every Strehl ratio lies between 0 and 1: "
            f"the number answers nothing{cause}",
        )
    if error > value:
        return Verdict(
            WORTHLESS,
            f"the Strehl ratio's error, {error:.2g}, is greater than the ratio itself, {value:.2g}: the number answers "
            f"nothing{cause}",
        )
    effect = 1.0 - value
    if error > max(effect, NO_EFFECT):
        return Verdict(
            WARNING,
            f"the Strehl ratio's error, {error:.2g}, is greater than the effect of the flow, which takes {effect:.2g} "
            f"off 1{cause}",
        )
    if error > GREAT_ERROR:
        return Verdict(WARNING, f"the Strehl ratio's error, {error:.2g}, is greater than a tenth of 1{cause}")
    return Verdict()
