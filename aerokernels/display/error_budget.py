"""The errors of a result by cause, in one order and with one total, whatever computed the result.

"+-" covers the truth in at least 95 of 100 cases. That holds for every entry and for the total, which is the root sum
of squares of all other entries. An entry that could not be measured is NaN, and so is the total.
"""

import math
from collections.abc import Mapping

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


class ErrorBudget(dict[str, float]):
    """Errors by cause, and their "total": a dictionary that prints as one line of rounded numbers.

    Attributes:
        unit: Unit of the entries; empty for a ratio.
    """

    unit: str = ""

    def __repr__(self) -> str:
        """Return the errors with two digits: "ErrorBudget [nm]: step 0.0021, ..., total 1.5"."""
        unit, factor = PRINTED.get(self.unit, (self.unit, 1.0))
        entries = ", ".join(f"{cause} {two_digits(factor * error)}" for cause, error in self.items())
        return f"ErrorBudget{f' [{unit}]' if unit else ''}: {entries or 'not known'}"


def combine(causes: Mapping[str, float], unit: str = "") -> ErrorBudget:
    """Return the budget of errors by cause, 0 for a cause that is not given, with their root sum of squares."""
    found = ErrorBudget({cause: float(causes.get(cause, 0.0)) for cause in CAUSES})
    found[TOTAL] = math.sqrt(sum(error * error for error in found.values()))
    found.unit = unit
    return found


def unknown(unit: str = "") -> ErrorBudget:
    """Return a budget in which no entry is known."""
    return combine(dict.fromkeys(CAUSES, math.nan), unit)


def two_digits(error: float) -> str:
    """Return an error with two digits, "not known" for NaN."""
    return "not known" if math.isnan(error) else f"{error:.2g}"
