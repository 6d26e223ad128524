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


def main_cause(budget: Mapping[str, float]) -> str:
    """Return the cause of the greatest part of an error and its remedy, in words; empty for an empty budget."""
    causes = {cause: error for cause, error in budget.items() if cause != TOTAL}
    if not causes:
        return ""
    unknown = [cause for cause, error in causes.items() if math.isnan(error)]
    worst = unknown[0] if unknown else max(causes, key=lambda cause: causes[cause])
    words = REMEDIES.get(worst, worst)
    return f"not known is the part of {words}" if unknown else f"most of it comes from {words}"
