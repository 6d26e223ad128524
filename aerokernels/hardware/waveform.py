"""The base class of recorded echoes of all protocols: counts, their scale in volts, and their times."""

from operator import index
from typing import Any

import numpy as np


class Waveform:
    """Counts of an analogue-to-digital converter as volts over time.

    volts = offset + scale * sample, and the time of sample k is first_sample_time + k * sample period.

    Attributes:
        sample_period_ps: time between two samples [ps].
        scale: [V/count].
        offset: [V].
        samples: counts, int16, shape (sample_count,).
        first_sample_time: time of the first sample [s].
    """

    sample_period_ps: float
    scale: float
    offset: float
    samples: np.ndarray
    first_sample_time: float = 0.0

    @property
    def voltage(self) -> np.ndarray:
        """Samples as volts [V], float64, shape (sample_count,)."""
        return self.offset + self.scale * self.samples.astype(np.float64)

    @property
    def time(self) -> np.ndarray:
        """Time of each sample [s], float64, shape (sample_count,)."""
        return self.first_sample_time + np.arange(self.samples.size) * (self.sample_period_ps * 1e-12)

    @property
    def peak(self) -> float | None:
        """Greatest voltage [V]; None without samples."""
        if not self.samples.size:
            return None
        extreme = self.samples.max() if self.scale >= 0.0 else self.samples.min()
        return self.offset + self.scale * float(extreme)


def as_counts(samples: Any) -> np.ndarray:
    """Return counts as an int16 array of shape (sample_count,) that cannot be written to.

    Raises:
        ValueError: more than one row, counts that are not whole numbers, or that do not fit int16.
    """
    counts = np.asarray(samples)
    if counts.ndim != 1:
        raise ValueError(f"samples have shape {counts.shape}: give one row of counts")
    if counts.size and (counts.dtype.kind not in "iu" or counts.min() < -32768 or counts.max() > 32767):
        raise ValueError(f"samples of type {counts.dtype} do not fit int16: scale and round them to counts first")
    counts = counts.astype(np.int16)
    counts.flags.writeable = False
    return counts


def as_whole(value: Any, name: str) -> int:
    """Return a whole number as Python's own; raise a TypeError that names any other value."""
    try:
        return index(value)
    except TypeError:
        raise TypeError(f"{name} must be a whole number, got {value!r}") from None
