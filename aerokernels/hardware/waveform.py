"""The base class of recorded echoes of all protocols: counts, their scale in volts, and their times."""

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
