"""Compute the mean waveform and the spread of many recorded echoes, in one pass and bounded memory.

A digitiser rounds to steps q. Noise of standard deviation sigma averages the rounding out; what is left of it is about

    q / 2 exp(-2 pi^2 sigma^2 / q^2)

Reference: B. Widrow, I. Kollar, Quantization Noise, Cambridge (2008), chapter 4.
"""

import itertools
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from aerokernels.jobs.recorded import LEAST_SAMPLES, RecordedEcho

# An echo is resampled if its times differ from the mean's by more than this share of a sample period.
SAME_TIME = 1e-6
# The digitiser's step is searched in so many echoes; differences below this share of the peak are rounding errors.
STEP_ECHOES, ROUNDING = 16, 1e-9
# Most echoes, and most samples of them, by which the usual time axis is chosen.
FIRST_ECHOES, FIRST_SAMPLES = 1000, 2**22
# An echo has no pulse if its greatest sample is below this share of the mean's.
LEAST_PULSE = 0.25


@dataclass(frozen=True, eq=False)
class AverageEcho:
    """The mean of a group of echoes.

    Attributes:
        time: sample times that most echoes have [s], shape (n,).
        mean: mean voltage [V], shape (n,).
        spread: standard deviation of one echo in each sample [V], shape (n,); NaN where only one echo has a sample.
        standard_error: standard error of the mean in each sample [V], shape (n,); NaN where the spread is.
        count: echoes in the mean.
        peak_mean: mean of the echoes' own greatest samples [V]; noise makes it higher than the mean's peak.
        peak_spread: standard deviation of those [V]; NaN for a single echo.
        resampled_count: echoes with other times.
        greatest: greatest sample of all echoes [V].
        greatest_share: share of the echoes that reach it, 0 to 1.
        equal_count: samples in a row that are equal to it, the median over these echoes.
        without_pulse_count: echoes whose greatest sample is below `least_peak`.
        repeated_count: echoes whose samples are those of the echo before.
        step: least difference of two samples of an echo [V]: the digitiser's step, unless noise or averaging hide it.
    """

    time: np.ndarray
    mean: np.ndarray
    spread: np.ndarray
    standard_error: np.ndarray
    count: int
    peak_mean: float
    peak_spread: float
    resampled_count: int
    greatest: float
    greatest_share: float
    equal_count: float
    without_pulse_count: int
    repeated_count: int
    step: float

    @property
    def rounding(self) -> float:
        """What the noise leaves of the digitiser's rounding in a sample of the mean [V]: at most half a step."""
        known = self.spread[np.isfinite(self.spread)]
        if not self.step > 0.0:
            return 0.0
        noise = math.sqrt(float(np.mean(known**2))) if known.size else 0.0  # not known for a single echo
        return 0.5 * self.step * math.exp(-2.0 * (math.pi * noise / self.step) ** 2)

    @property
    def least_peak(self) -> float:
        """Voltage that a record with a pulse reaches: a quarter of the mean's peak [V]."""
        return LEAST_PULSE * float(self.mean.max())


def average(echoes: Iterable[RecordedEcho]) -> AverageEcho:
    """Average echoes on the time axis that most of them have, as the first thousand show.

    An echo with other times is interpolated on that axis by the cubic spline through its samples, within its own times
    only. The spline follows a pulse with six samples on its rise to 1e-3 of its height, and hardly changes the noise.

    Raises:
        ValueError: no echoes, or an echo whose times do not overlap those of the others.
    """
    source = iter(echoes)
    head = _first_echoes(source)
    if not head:
        raise ValueError(f"there are no echoes to average: each needs {LEAST_SAMPLES} samples and a sample period")
    time = _usual_time(head)
    period = _period(time)
    number, mean, square = np.zeros(time.size), np.zeros(time.size), np.zeros(time.size)
    peaks: list[float] = []
    equal: list[int] = []
    steps: list[float] = []
    resampled = repeated = 0
    before = np.empty(0)
    for echo in itertools.chain(head, source):
        volts = echo.voltage
        peaks.append(float(volts.max()))
        repeated += np.array_equal(volts, before)
        before = volts
        equal.append(_equal_in_a_row(volts))
        if len(steps) < STEP_ECHOES:
            steps.append(_least_step(volts))
        if echo.time.shape != time.shape or np.abs(echo.time - time).max() > SAME_TIME * period:
            resampled += 1
            volts = _at_times(time, echo)
        there = np.isfinite(volts)
        if not there.any():
            raise ValueError(
                f"an echo runs from {1e9 * echo.time[0]:.3f} to {1e9 * echo.time[-1]:.3f} ns, the others from "
                f"{1e9 * time[0]:.3f} to {1e9 * time[-1]:.3f} ns: give echoes of different settings different labels"
            )
        number += there  # Welford's recurrence, for each sample separately
        step = np.where(there, volts - mean, 0.0)
        mean += step / np.maximum(number, 1.0)
        square += step * np.where(there, volts - mean, 0.0)
    at_top = np.array(peaks) == max(peaks)
    spread = np.sqrt(np.divide(square, number - 1.0, where=number > 1.0, out=np.full(time.size, np.nan)))
    return AverageEcho(
        time=time,
        mean=mean,
        spread=spread,
        standard_error=spread / np.sqrt(number),
        count=len(peaks),
        peak_mean=float(np.mean(peaks)),
        peak_spread=float(np.std(peaks, ddof=1)) if len(peaks) > 1 else math.nan,
        resampled_count=resampled,
        greatest=max(peaks),
        greatest_share=float(np.mean(at_top)),
        equal_count=float(np.median(np.array(equal)[at_top])),
        without_pulse_count=int(np.count_nonzero(np.array(peaks) < LEAST_PULSE * mean.max())),
        repeated_count=repeated,
        step=min(steps),
    )


def _first_echoes(source: Iterator[RecordedEcho]) -> list[RecordedEcho]:
    """Take the echoes by which the time axis is chosen."""
    head: list[RecordedEcho] = []
    samples = 0
    while len(head) < FIRST_ECHOES and samples < FIRST_SAMPLES and (echo := next(source, None)) is not None:
        head.append(echo)
        samples += echo.time.size
    return head


def _usual_time(echoes: Sequence[RecordedEcho]) -> np.ndarray:
    """Return the times of the first echo of the most usual length and period and, among these, the most usual start."""
    lengths = [(echo.time.size, float(f"{_period(echo.time):.6g}")) for echo in echoes]
    (usual, _), *_ = Counter(lengths).most_common(1)
    alike = [echo.time for echo, length in zip(echoes, lengths, strict=True) if length == usual]
    starts = [round(float(time[0]) / usual[1], 6) for time in alike]
    (start, _), *_ = Counter(starts).most_common(1)
    return alike[starts.index(start)]


def _period(time: np.ndarray) -> float:
    return float(time[-1] - time[0]) / (time.size - 1)


def _equal_in_a_row(volts: np.ndarray) -> int:
    """Return the number of samples in a row, from the first greatest one on, that are equal to it."""
    top = int(np.argmax(volts))
    other = np.flatnonzero(volts[top:] != volts[top])
    return int(other[0]) if other.size else volts.size - top


def _least_step(volts: np.ndarray) -> float:
    """Return the least difference of two samples [V] that is more than rounding; 0 for a constant record."""
    steps = np.diff(np.unique(volts))
    steps = steps[steps > ROUNDING * float(np.abs(volts).max())]
    return float(steps.min()) if steps.size else 0.0


def _at_times(time: np.ndarray, echo: RecordedEcho) -> np.ndarray:
    """Return the echo's voltage at other times; NaN outside its own times."""
    from scipy.interpolate import make_interp_spline

    inside = (time >= echo.time[0]) & (time <= echo.time[-1])
    volts = np.full(time.size, np.nan)
    volts[inside] = make_interp_spline(echo.time - echo.time[0], echo.voltage, k=3)(time[inside] - echo.time[0])
    return volts
