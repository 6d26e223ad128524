"""Compute the mean waveform and the spread of many recorded echoes, in one pass and bounded memory."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from aerokernels.jobs.recorded import LEAST_SAMPLES, RecordedEcho

# An echo is resampled if its times differ from the first echo's by more than this share of a sample period.
SAME_TIME = 1e-6
# The digitiser's step is searched in so many echoes; differences below this share of the peak are rounding errors.
STEP_ECHOES, ROUNDING = 16, 1e-9


@dataclass(frozen=True, eq=False)
class AverageEcho:
    """The mean of a group of echoes.

    Attributes:
        time: sample times of the group's first echo [s], shape (n,).
        mean: mean voltage [V], shape (n,).
        spread: standard deviation of one echo in each sample [V], shape (n,); NaN where only one echo has a sample.
        standard_error: standard error of the mean in each sample [V], shape (n,); NaN where the spread is.
        count: echoes in the mean.
        peak_mean: mean of the echoes' own greatest samples [V]; noise makes it higher than the mean's peak.
        peak_spread: standard deviation of those [V]; NaN for a single echo.
        resampled_count: echoes whose times differed from the first one's.
        greatest: greatest sample of all echoes [V].
        greatest_share: share of the echoes that reach it, 0 to 1.
        equal_count: samples in a row that are equal to it, the median over these echoes.
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
    step: float


def average(echoes: Iterable[RecordedEcho]) -> AverageEcho:
    """Average echoes on the time axis of the first.

    An echo with other times is interpolated on that axis by the cubic spline through its samples, within its own times
    only. The spline follows a pulse with six samples on its rise to 1e-3 of its height, and hardly changes the noise.

    Raises:
        ValueError: no echoes, or an echo whose times do not overlap those of the first.
    """
    time: np.ndarray | None = None
    peaks, equal, steps = [], [], []
    resampled = 0
    for echo in echoes:
        volts = echo.voltage
        peaks.append(float(volts.max()))
        equal.append(_equal_in_a_row(volts))
        if len(steps) < STEP_ECHOES:
            steps.append(_least_step(volts))
        if time is None:
            time = echo.time
            period = float(time[-1] - time[0]) / (time.size - 1)
            number, mean, square = np.zeros(time.size), np.zeros(time.size), np.zeros(time.size)
        elif echo.time.shape != time.shape or np.abs(echo.time - time).max() > SAME_TIME * period:
            resampled += 1
            volts = _at_times(time, echo)
        there = np.isfinite(volts)
        if not there.any():
            raise ValueError(
                f"an echo runs from {1e9 * echo.time[0]:.3f} to {1e9 * echo.time[-1]:.3f} ns, the first one from "
                f"{1e9 * time[0]:.3f} to {1e9 * time[-1]:.3f} ns: give echoes of different settings different labels"
            )
        number += there  # Welford's recurrence, for each sample separately
        step = np.where(there, volts - mean, 0.0)
        mean += step / np.maximum(number, 1.0)
        square += step * np.where(there, volts - mean, 0.0)
    if time is None:
        raise ValueError(f"there are no echoes to average: each needs {LEAST_SAMPLES} samples and a sample period")
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
        step=min(steps),
    )


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
