"""Hold the errors of an echo's numbers, which echo_errors.py computes."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

SPREADS = 2.0  # of these standard deviations noise exceeds 5 times in 100


@dataclass(frozen=True)
class RangeUncertainty:
    """The error of a range.

    Attributes:
        systematic: Error common to all records of the scene [m].
        random: Standard deviation between records [m]; 0 if the scene has no noise.
        refractivity: Part of `systematic` due to the refractivity model: its uncertainty of the whole group path [m].
    """

    systematic: float
    random: float
    refractivity: float = 0.0

    @property
    def total(self) -> float:
        """Error of one record's range, which covers the truth in 95 of 100 cases [m]."""
        return math.hypot(self.systematic, SPREADS * self.random)


@dataclass(frozen=True)
class EchoErrors:
    """The errors of an echo's numbers; NaN if not known.

    Attributes:
        strehl: Error of the mean Strehl ratio.
        peak_power: Error of the peak power [W].
        peak_voltage: Error of the peak voltage [V].
        ranges: Errors of the range by method.
    """

    strehl: float = math.nan
    peak_power: float = math.nan
    peak_voltage: float = math.nan
    ranges: Mapping[str, RangeUncertainty] | None = None

    def of_range(self, method: str) -> float:
        """Return the error of the range by a method [m]."""
        return self.ranges[method].total if self.ranges and method in self.ranges else math.nan
