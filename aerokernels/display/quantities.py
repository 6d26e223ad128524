"""Format a number with its error.

    0.9779 +- 0.0041      the error has two digits; the value ends where the error ends
    13.8 +- 2100 V        and has three significant digits or more, whatever its error
    (2.15 +- 0.12)e-08    one power of ten for both, if plain digits would need many zeros
    0.999 (0.988 to 1)    a ratio that its error would take beyond 0 or 1
    0.978, error not known
    1, error below rounding
    0.3, not meaningful: its error allows any ratio from 0 to 1

"+-" covers the truth in at least 95 of 100 cases: value and error of 100 different answers contain the exact answer, of
the same flow, in 95 or more. Errors of independent causes add as the root of the sum of their squares.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

LEAST_DIGITS, MOST_DIGITS = 3, 9  # significant digits that a value is written with
LEAST_POWER, GREATEST_POWER = -4, 6  # powers of ten beyond which value and error are written with a common power
CAUSES = (
    "step",
    "precision",
    "interpolation",
    "jumps",
    "resampling",
    "truncation",
    "refractivity",
    "bundle",
    "sampling",
)
TOTAL = "total"
# Units in which a budget is printed, with their factor from SI.
PRINTED = {"m": ("nm", 1e9), "rad": ("urad", 1e6)}
# Causes of an error in words, each with its remedy.
REMEDIES = {
    "step": "the steps of the rays: ask for a smaller tolerance",
    "precision": "the precision of the kernels: trace in float64",
    "interpolation": "the samples of the field itself: give it finer cells",
    "jumps": "jumps of the index between samples: give the field finer cells, or averages of cells",
    "resampling": "the uniform grid: give it a smaller spacing",
    "truncation": "air beyond the region that was resampled: give it a larger region",
    "refractivity": "the refractivity model: take one of a smaller uncertainty, such as 'ciddor' in air",
    "sampling": "the number of rays: take more",
}
FINE, WARNING, WORTHLESS = "fine", "warning", "worthless"
LEVELS = (FINE, WARNING, WORTHLESS)


@dataclass(frozen=True)
class Quantity:
    """A number, its error and its unit.

    Attributes:
        value: The number; NaN if there is none.
        error: Its error, in the same unit; NaN: not known; infinite: without bound; 0: below rounding; None: the
            number is no estimate (a count, a setting) and has no error.
        unit: Unit of both, as it is written.
        is_ratio: The number is between 0 and 1: a greater error than these bounds allow is reduced to
            max(value, 1 - value), and the number is not meaningful. Its unit is none.
    """

    value: float
    error: float | None = math.nan
    unit: str = ""
    is_ratio: bool = False

    def __post_init__(self) -> None:
        """Check the error, and limit a ratio, which rounding may take beyond its bounds, and its error.

        Raises:
            ValueError: A negative error.
        """
        if self.error is not None and self.error < 0.0:
            raise ValueError(f"an error is not negative, got {self.error!r} for the value {self.value!r}")
        if self.is_ratio:
            object.__setattr__(self, "value", min(max(self.value, 0.0), 1.0))
            if self.allows_any_ratio:
                object.__setattr__(self, "error", greatest_ratio_error(self.value))

    @property
    def interval(self) -> tuple[float, float]:
        """Least and greatest value that the error allows, in the number's unit; a ratio's are within 0 and 1."""
        error = self.error or 0.0
        low, high = self.value - error, self.value + error
        return (max(low, 0.0), min(high, 1.0)) if self.is_ratio else (low, high)

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
        text = f"{self.value:{sign}.6g}{unit}"
        if self.error is None:
            return text
        if math.isnan(self.error):
            return f"{text}, error not known"
        if math.isinf(self.error) or math.isinf(self.value):
            return f"{text}, error without bound"
        if self.allows_any_ratio:
            return f"{self.value:.{LEAST_DIGITS}g}, not meaningful: its error allows any ratio from 0 to 1"
        if self.error == 0.0:
            return f"{text}, error below rounding"
        if self.is_ratio and self.error > max(min(self.value, 1.0 - self.value), 10.0**-MOST_DIGITS):
            return _with_interval(self)
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


def _with_interval(ratio: Quantity) -> str:
    """Return a ratio with the interval that its error allows: "0.999 (0.988 to 1)"."""
    places = -_last_place(ratio.value, ratio.error or 0.0)
    form = f".{places}f" if max(ratio.interval) >= 10.0**LEAST_POWER else ".3g"
    low, high = (f"{end:g}" if end in (0.0, 1.0) else f"{end:{form}}" for end in ratio.interval)
    return f"{ratio.value:{form}} ({low} to {high})"


def _joined(value: float, error: float, sign: str, unit: str) -> str:
    """Return value and error, the value to the error's last place or farther."""
    after = f" {unit}" if unit else ""
    sign = sign if value else ""
    if value and _power(error) - _power(value) > 4:  # each with a power of its own
        return f"{value:{sign}.3g} +- {error:.2g}{after}"
    last, own = _last_place(value, error), _power(error, 2) - 1
    top = max(_power(value), _power(error))
    small = f"{error:.2g}" if own < last else None  # an error smaller than the last digit of the value
    if LEAST_POWER < top < GREATEST_POWER:
        text = f"{round(value, -last):{sign}.{max(-last, 0)}f}"
        return f"{text} +- {small or f'{round(error, -own):.{max(-own, 0)}f}'}{after}"
    scale = 10.0**top
    text = f"{value / scale:{sign}.{max(top - last, 0)}f}"
    if small is not None:
        return f"{text}e{top:+03d} +- {small}{after}"
    return f"({text} +- {error / scale:.{max(top - own, 0)}f})e{top:+03d}{after}"


def _last_place(value: float, error: float) -> int:
    """Return the power of ten of a value's last digit: that of the error's second, within the limits above."""
    last = _power(error, 2) - 1
    if not value:
        return last
    first = _power(value, LEAST_DIGITS)
    return max(min(last, first - LEAST_DIGITS + 1), first - MOST_DIGITS + 1)


def _power(number: float, digits: int = LEAST_DIGITS) -> int:
    """Return the power of ten of the first digit of a number that is rounded to so many digits."""
    return int(f"{number:.{digits - 1}e}".partition("e")[2]) if number else -400


def root_sum_square(errors: Iterable[float]) -> float:
    """Return the error of a number from the errors of independent causes."""
    return math.sqrt(sum([error * error for error in errors]))


class ErrorBudget(dict[str, float]):
    """Errors by cause, and their "total": a dictionary that prints as one line of rounded numbers."""

    unit: str = ""  # of the entries; empty for a ratio

    def __repr__(self) -> str:
        """Return the errors with two digits: "ErrorBudget [nm]: step 0.0021, ..., total 1.5"."""
        unit, factor = PRINTED.get(self.unit, (self.unit, 1.0))
        entries = ", ".join(f"{cause} {two_digits(factor * error)}" for cause, error in self.items())
        return f"ErrorBudget{f' [{unit}]' if unit else ''}: {entries or 'not known'}"


def combine(causes: Mapping[str, float], unit: str = "") -> ErrorBudget:
    """Return the budget of errors by cause, 0 for a cause that is not given, with their root sum of squares."""
    found = ErrorBudget({cause: float(causes.get(cause, 0.0)) for cause in CAUSES})
    found[TOTAL] = root_sum_square(found.values())
    found.unit = unit
    return found


def unknown(unit: str = "") -> ErrorBudget:
    """Return a budget in which no entry is known."""
    return combine(dict.fromkeys(CAUSES, math.nan), unit)


def two_digits(error: float) -> str:
    """Return an error with two digits, "not known" for NaN."""
    return "not known" if math.isnan(error) else f"{error:.2g}"


def main_cause(budget: Mapping[str, float]) -> str:
    """Return the cause of the greatest part of an error and its remedy, in words; empty for an empty budget."""
    causes = {cause: error for cause, error in budget.items() if cause != TOTAL}
    if not causes:
        return ""
    unknown = [cause for cause, error in causes.items() if math.isnan(error)]
    worst = unknown[0] if unknown else max(causes, key=lambda cause: causes[cause])
    words = REMEDIES.get(worst, worst)
    return f"not known is the part of {words}" if unknown else f"most of it comes from {words}"


@dataclass(frozen=True)
class Verdict:
    """Whether a number is meaningful given its error."""

    level: str = FINE  # "warning": read the number with its error in mind; "worthless": the number is not meaningful
    reason: str = ""  # in one sentence; empty if the level is "fine"

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
    none, and an error of that size gives no warning. `main_cause` is that of the errors, with the remedy, in words.
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
    greater = f"'s error, {error:.2g}, is greater than"
    if not number.is_ratio:
        return (WORTHLESS, f"{greater} the number itself, {value:.3g}") if error > abs(value) else (FINE, "")
    if error > value:
        return WARNING, f"{greater} the ratio itself, {value:.3g}"
    if error > max(1.0 - value, 1e-6):
        return WARNING, f"{greater} the effect of the flow, which reduces the ratio by {1.0 - value:.2g}"
    return (WARNING, f"{greater} a tenth of 1") if error > 0.1 else (FINE, "")
