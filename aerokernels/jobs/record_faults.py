"""Find what is wrong with recorded echoes: cut-off peaks, an offset, echoes without a pulse or repeated ones.

A peak is cut off where the greatest samples of an echo are equal, and more of them than the simulated pulse has there
if it is rounded in the steps of the record. An offset is the mean of recorded minus simulated voltage before the pulse,
or after it where the record begins too late.
"""

import math
from dataclasses import dataclass

import numpy as np

from aerokernels.display.quantities import Quantity
from aerokernels.jobs.averages import AverageEcho
from aerokernels.jobs.mean_errors import covering

# Equal greatest samples beyond those that rounding explains from which they are a cut, and the least share of echoes
# that are cut off, or repeated.
MORE_EQUAL, LEAST_SHARE = 2, 0.1
# Share of the simulated peak below which there is no pulse, and the least number of such samples.
NO_PULSE, LEAST_COUNT = 1e-3, 8
# An offset is reported above so many of its standard errors, and above this share of the peak.
OFFSET_SIGMAS, LEAST_OFFSET = 5.0, 1e-3


@dataclass(frozen=True)
class RecordFaults:
    """What is wrong with the voltages of a label's echoes.

    Attributes:
        cut_off_share: share of the echoes whose peak is cut off, 0 to 1.
        cut_off_level: voltage at which they are cut off [V].
        offset: recorded minus simulated voltage where there is no pulse [V]; NaN if the record has no such samples.
        offset_error: its standard error [V].
        peak: greatest recorded voltage of the mean [V].
        without_pulse_count: number of echoes without a pulse.
        repeated_count: number of echoes that repeat the one before, though others differ.
        count: number of echoes.
    """

    cut_off_share: float
    cut_off_level: float
    offset: float
    offset_error: float
    peak: float
    without_pulse_count: int
    repeated_count: int
    count: int

    @property
    def is_cut_off(self) -> bool:
        """Whether the peaks are cut off."""
        return self.cut_off_share >= LEAST_SHARE

    @property
    def has_offset(self) -> bool:
        """Whether there is an offset that matters."""
        return abs(self.offset) > max(OFFSET_SIGMAS * self.offset_error, LEAST_OFFSET * self.peak)

    @property
    def sentences(self) -> list[str]:
        """The faults with their remedies, in words."""
        found = []
        if self.repeated_count > LEAST_SHARE * self.count:
            found.append(
                f"{self.repeated_count} of {self.count} echoes repeat the one before in every sample, as where an "
                "oscilloscope is read faster than it acquires: the errors, which count each echo, are too small; "
                "trigger it more often"
            )
        if self.without_pulse_count:
            found.append(
                f"{self.without_pulse_count} of {self.count} echoes have no pulse (their greatest sample is "
                "below a quarter of the mean's): they lower the mean and have no range; record such echoes under "
                "another label"
            )
        if self.is_cut_off:
            found.append(
                f"the peak of {100.0 * self.cut_off_share:.0f} % of the echoes is cut off at {self.cut_off_level:.4g} "
                "V, as by an amplifier or a digitiser beyond its range: peaks, their errors, widths and ranges by "
                "constant fraction are not the echo's; attenuate the signal, or raise the digitiser's range"
            )
        if self.has_offset:
            size = Quantity(1e3 * self.offset, 1e3 * covering(self.count) * self.offset_error, "mV")
            found.append(
                f"the recorded voltage has an offset, {size.text(signed=True)} where there is no pulse: it adds to "
                "every peak, and moves leading edge and constant fraction; set the instrument's offset to zero, or "
                "subtract it as voltage offset"
            )
        return found


def record_faults(recorded: AverageEcho, mean: np.ndarray, simulated: np.ndarray) -> RecordFaults:
    """Examine the echoes of a label.

    Args:
        recorded: mean and statistics of the echoes.
        mean: recorded mean where both are known [V], shape (n,).
        simulated: simulated voltage there [V], shape (n,).
    """
    cut = recorded.equal_count > _equal_by_rounding(simulated, recorded.step / recorded.greatest) + MORE_EQUAL
    top = int(np.argmax(simulated))
    is_quiet = np.abs(simulated) < NO_PULSE * simulated[top]
    # The recorded pulse may be elsewhere: no pulse either where the simulated one would be quiet at the recorded place.
    place = np.arange(simulated.size) - (int(np.argmax(mean)) - top)
    is_quiet &= np.where((place >= 0) & (place < simulated.size), is_quiet[place.clip(0, simulated.size - 1)], True)
    before, after = np.flatnonzero(is_quiet[:top]), top + np.flatnonzero(is_quiet[top:])
    quiet = before if before.size >= LEAST_COUNT else after
    offset = error = math.nan
    if quiet.size >= LEAST_COUNT:
        difference = mean[quiet] - simulated[quiet]
        offset, error = float(difference.mean()), float(difference.std(ddof=1)) / math.sqrt(quiet.size)
    share = recorded.greatest_share if cut else 0.0
    return RecordFaults(
        cut_off_share=share,
        cut_off_level=recorded.greatest,
        offset=offset,
        offset_error=error,
        peak=float(mean.max()),
        without_pulse_count=recorded.without_pulse_count,
        repeated_count=recorded.repeated_count if np.nanmax(recorded.spread, initial=0.0) > 0.0 else 0,
        count=recorded.count,
    )


def _equal_by_rounding(simulated: np.ndarray, step: float) -> int:
    """Return how many samples around the peak a rounding in steps of this share of the peak can make equal."""
    top = int(np.argmax(simulated))
    lower = np.flatnonzero(simulated < simulated[top] * (1.0 - step))
    before, after = lower[lower < top], lower[lower > top]
    return int((after[0] if after.size else simulated.size) - (before[-1] if before.size else -1) - 1)
