"""Options of a comparison of recorded echoes with runs."""

from dataclasses import dataclass

import numpy as np

from aerokernels.inputs.checks import check_count
from aerokernels.inputs.kinds import is_number

NO_ALIGNMENT, EACH = "none", "each"


@dataclass(frozen=True)
class CompareOptions:
    """Options of a comparison.

    Attributes:
        align: "none", "each", or the label on which the trigger offset is measured, such as "mach=0".
        trigger_offset: time by which the recorded time axis is late, where it is known [s].
        voltage_offset: voltage of the recorded echoes without light, where it is known [V]; it is subtracted.
        threshold: level of the leading edge [V]; None takes the run's threshold.
        ranged_count: greatest number of randomly chosen echoes of a label that are ranged one by one.
        seed: seed of that random choice.
    """

    align: str = NO_ALIGNMENT
    trigger_offset: float = 0.0
    voltage_offset: float = 0.0
    threshold: float | None = None
    ranged_count: int = 300
    seed: int = 0

    def __post_init__(self) -> None:
        """Check.

        Raises:
            ValueError: an invalid option.
            TypeError: an option of another kind.
        """
        if not isinstance(self.align, str):
            raise TypeError(f"align must be none, each, or a label such as mach=0, got {self.align!r}")
        if self.align not in (NO_ALIGNMENT, EACH) and "=" not in self.align:
            raise ValueError(f"align {self.align!r}: give none, each, or a label such as mach=0")
        for name, unit in (("trigger_offset", "a time in seconds"), ("voltage_offset", "a voltage in volts")):
            if not is_number(given := getattr(self, name)):
                raise TypeError(f"{name} must be {unit}, got {given!r}")
            if not np.isfinite(given):
                raise ValueError(f"{name} = {given}: give {unit}")
        if self.trigger_offset and self.align != NO_ALIGNMENT:
            raise ValueError(f"trigger_offset and align {self.align}: give the offset, or have it measured, not both")
        if self.threshold is not None and not is_number(self.threshold):
            raise TypeError(f"threshold must be a voltage in volts or None, got {self.threshold!r}")
        if self.threshold is not None and not (np.isfinite(self.threshold) and self.threshold > 0.0):
            raise ValueError(f"threshold = {self.threshold}: give a positive voltage")
        check_count(self.ranged_count, "ranged_count", least=2)  # a spread needs two echoes
        check_count(self.seed, "seed", 0, 2**63 - 1)
