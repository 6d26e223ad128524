"""What the numbers of an echo may be off by, as results carry it; echo_errors.py measures it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class RangeUncertainty:
    """What a range may be off by.

    Attributes:
        systematic: Alike in every record of the scene [m].
        random: Standard deviation between records [m]; 0 where the scene has no noise.
    """

    systematic: float
    random: float

    @property
    def total(self) -> float:
        """Root sum of squares [m]."""
        return math.hypot(self.systematic, self.random)


@dataclass(frozen=True)
class EchoErrors:
    """What an echo's numbers may be off by; NaN where that is not known.

    Attributes:
        strehl: Error of the mean Strehl ratio.
        peak_power: Of the peak power [W].
        peak_voltage: Of the peak voltage [V].
        ranges: By method.
    """

    strehl: float = math.nan
    peak_power: float = math.nan
    peak_voltage: float = math.nan
    ranges: Mapping[str, RangeUncertainty] | None = None

    def of_range(self, method: str) -> float:
        """Error of the range by a method [m]."""
        return self.ranges[method].total if self.ranges and method in self.ranges else math.nan
