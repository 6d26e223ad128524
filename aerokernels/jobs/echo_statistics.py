"""Compute the mean waveform and the spread of many recorded echoes, in one pass and bounded memory, and their errors.

A digitiser rounds to steps q. Noise of standard deviation sigma averages the rounding out; what is left of it is about
q / 2 exp(-2 pi^2 sigma^2 / q^2) (B. Widrow, I. Kollar, Quantization Noise, Cambridge (2008), chapter 4).
"""

import itertools
import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from aerokernels.display.quantities import Quantity
from aerokernels.jobs.recorded import LEAST_SAMPLES, RecordedEcho

# An echo has no pulse if its greatest sample is below this share of the mean's.
LEAST_PULSE = 0.25
COVERAGE = 0.6827  # probability of one standard deviation of a normal distribution
TOLD = 0.95  # least share of the cases in which value and error contain the truth


@dataclass(frozen=True, eq=False)
class AverageEcho:
    """The mean of a group of echoes."""

    time: np.ndarray  # sample times that most echoes have [s], shape (n,)
    mean: np.ndarray  # mean voltage [V], shape (n,)
    # standard deviation of one echo in each sample [V], shape (n,); NaN where only one echo has a sample
    spread: np.ndarray
    standard_error: np.ndarray  # standard error of the mean in each sample [V], shape (n,); NaN where the spread is
    count: int  # echoes in the mean
    peak_mean: float  # mean of the echoes' own greatest samples [V]; noise makes it higher than the mean's peak
    peak_spread: float  # standard deviation of those [V]; NaN for a single echo
    resampled_count: int  # echoes with other times
    greatest: float  # greatest sample of all echoes [V]
    greatest_share: float  # share of the echoes that reach it, 0 to 1
    equal_count: float  # samples in a row that are equal to it, the median over these echoes
    without_pulse_count: int  # echoes whose greatest sample is below LEAST_PULSE of the mean's
    # least difference of two samples of an echo [V]: the digitiser's step, unless noise or averaging hide it
    step: float

    @property
    def rounding(self) -> float:
        """What the noise leaves of the digitiser's rounding in a sample of the mean [V]: at most half a step."""
        known = self.spread[np.isfinite(self.spread)]
        if not self.step > 0.0:
            return 0.0
        noise = math.sqrt(float(np.mean(known**2))) if known.size else 0.0  # not known for a single echo
        return 0.5 * self.step * math.exp(-2.0 * (math.pi * noise / self.step) ** 2)


def average(echoes: Iterable[RecordedEcho]) -> AverageEcho:
    """Average echoes on the time axis that most of them have, as the first thousand show.

    An echo with other times is interpolated on that axis by the cubic spline through its samples, within its own times
    only. The spline follows a pulse with six samples on its rise to 1e-3 of its height, and hardly changes the noise.
    """
    source = iter(echoes)
    head = list(itertools.islice(source, 1000))
    if not head:
        raise ValueError(f"there are no echoes to average: each needs {LEAST_SAMPLES} samples and a sample period")
    time, period = _usual_time(head)
    number, mean, square = np.zeros(time.size), np.zeros(time.size), np.zeros(time.size)
    peaks: list[float] = []
    equal: list[int] = []
    steps: list[float] = []
    resampled = 0
    for echo in itertools.chain(head, source):
        volts = echo.voltage
        peaks.append(float(volts.max()))
        equal.append(_equal_in_a_row(volts))
        if len(steps) < 16:  # enough to find the digitiser's step
            steps.append(_least_step(volts))
        if echo.time.shape != time.shape or np.abs(echo.time - time).max() > 1e-6 * period:
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
    tops = np.array(peaks)
    at_top = tops == tops.max()
    spread = np.sqrt(np.divide(square, number - 1.0, where=number > 1.0, out=np.full(time.size, np.nan)))
    return AverageEcho(
        time=time,
        mean=mean,
        spread=spread,
        standard_error=spread / np.sqrt(number),
        count=len(peaks),
        peak_mean=float(tops.mean()),
        peak_spread=float(np.std(tops, ddof=1)) if len(peaks) > 1 else math.nan,
        resampled_count=resampled,
        greatest=float(tops.max()),
        greatest_share=float(np.mean(at_top)),
        equal_count=float(np.median(np.array(equal)[at_top])),
        without_pulse_count=int(np.count_nonzero(tops < LEAST_PULSE * mean.max())),
        step=min(steps),
    )


def _usual_time(echoes: list[RecordedEcho]) -> tuple[np.ndarray, float]:
    """Return the times of the most usual length, period and start, in this order, and the period [s]."""
    periods = [float(echo.time[-1] - echo.time[0]) / (echo.time.size - 1) for echo in echoes]
    kinds = [(echo.time.size, float(f"{period:.6g}")) for echo, period in zip(echoes, periods, strict=True)]
    (usual, _), *_ = Counter(kinds).most_common(1)
    starts = {k: round(float(echoes[k].time[0]) / usual[1], 6) for k, kind in enumerate(kinds) if kind == usual}
    (start, _), *_ = Counter(starts.values()).most_common(1)
    first = next(k for k, one in starts.items() if one == start)
    return echoes[first].time, periods[first]


def _equal_in_a_row(volts: np.ndarray) -> int:
    """Return the number of samples in a row, from the first greatest one on, that are equal to it."""
    top = int(np.argmax(volts))
    other = np.flatnonzero(volts[top:] != volts[top])
    return int(other[0]) if other.size else volts.size - top


def _least_step(volts: np.ndarray) -> float:
    """Return the least difference of two samples [V] that is more than rounding; 0 for a constant record."""
    steps = np.diff(np.unique(volts))
    steps = steps[steps > 1e-9 * float(np.abs(volts).max())]
    return float(steps.min()) if steps.size else 0.0


def _at_times(time: np.ndarray, echo: RecordedEcho) -> np.ndarray:
    """Return the echo's voltage at other times; NaN outside its own times."""
    from scipy.interpolate import make_interp_spline

    inside = (time >= echo.time[0]) & (time <= echo.time[-1])
    volts = np.full(time.size, np.nan)
    volts[inside] = make_interp_spline(echo.time - echo.time[0], echo.voltage, k=3)(time[inside] - echo.time[0])
    return volts


def mean_factor(count: int, coverage: float = COVERAGE) -> float:
    """Return the factor by which the standard error of a mean of `count` numbers is multiplied; NaN below two."""
    from scipy.special import stdtrit

    return float(stdtrit(count - 1, 0.5 * (1.0 + coverage))) if count > 1 else math.nan


def covering(count: int) -> float:
    """Return what the error of a mean of `count` numbers is multiplied by to cover 95 of 100 cases; NaN below two."""
    return mean_factor(count, TOLD) / mean_factor(count)


def spread_factor(count: int, coverage: float = COVERAGE) -> float:
    """Return the error of a standard deviation of `count` numbers as a share of it; NaN below two."""
    from scipy.optimize import brentq
    from scipy.special import gammainc

    if count < 2:
        return math.nan
    half = 0.5 * (count - 1)

    def missing(share: float) -> float:
        upper = gammainc(half, half / (1.0 - share) ** 2) if share < 1.0 else 1.0
        return float(upper - gammainc(half, half / (1.0 + share) ** 2)) - coverage

    return float(brentq(missing, 1e-9, 1e3))


@dataclass(frozen=True, eq=False)
class MeanErrors:
    """Errors of what is read from a mean echo; NaN for a single echo."""

    peak: float  # error of its greatest sample [V], with the mean excess of the greatest of several samples with noise
    edge_shift: float  # error of the time at which it crosses a level [s]; NaN where the pulse does not
    lag: float  # error of the lag at which it correlates best with the simulation [s]


def mean_errors(recorded: AverageEcho, simulated: np.ndarray, level: float, offset_error: float = 0.0) -> MeanErrors:
    """Compute the errors of a mean echo.

    Args:
        recorded: the mean and its spread.
        simulated: the simulation at its times [V], shape (n,); not constant.
        level: level of the leading edge [V].
        offset_error: error of a trigger offset that was subtracted from the times [s].
    """
    mean, known = recorded.mean, np.isfinite(recorded.spread)
    error = np.hypot(mean_factor(recorded.count) * recorded.standard_error, recorded.rounding)
    top = int(np.argmax(mean))
    slope = np.abs(np.gradient(mean[top] / simulated.max() * simulated, recorded.time))
    crossed = np.flatnonzero((mean[1:] >= level) & (mean[:-1] < level))
    edge = lag = math.nan
    if crossed.size:
        at = int(crossed[0]) + int(mean[crossed[0] + 1] - level < level - mean[crossed[0]])
        edge = float(error[at] / slope[at]) if slope[at] > 0.0 else math.nan
    if known.any():
        # All samples take part in the lag, so that the few echoes of each need no factor.
        each = np.hypot(recorded.standard_error, recorded.rounding)
        lag = float(np.linalg.norm((slope * each)[known]) / np.sum(slope[known] ** 2))
    return MeanErrors(
        peak=math.hypot(float(error[top]), _excess(simulated * (mean[top] / simulated.max()), error)),
        edge_shift=math.hypot(edge, offset_error),
        lag=math.hypot(lag, offset_error),
    )


def _excess(volts: np.ndarray, error: np.ndarray) -> float:
    """Return by how much errors of the samples lift the greatest one on average [V]; NaN where an error is."""
    near = volts > volts.max() - 6.0 * error[int(np.argmax(volts))]
    if not near.any():
        return 0.0 if np.isfinite(error[int(np.argmax(volts))]) else math.nan
    volts, error = volts[near], np.nan_to_num(error[near])
    noise = np.random.default_rng(0).standard_normal((200, volts.size))
    return float((volts + error * noise).max(axis=1).mean()) - float(volts.max())


@dataclass(frozen=True)
class RecordFaults:
    """What the digitiser did to the voltages of a label's echoes."""

    cut_off_share: float  # share of the echoes whose peak is cut off, 0 to 1
    offset: float  # recorded minus simulated voltage where there is no pulse [V]; NaN if the record has no such samples
    offset_error: float  # its standard error [V]
    sentences: tuple[str, ...]  # the faults with their remedies, in words
    is_distorted: bool  # whether the pulse's width is not the echo's


def record_faults(recorded: AverageEcho, simulated: np.ndarray) -> RecordFaults:
    """Examine the echoes of a label, whose simulation at the same times is `simulated` [V], shape (n,)."""
    top = int(np.argmax(simulated))
    # Two samples more than rounding can make equal are a cut.
    is_cut = recorded.equal_count > _equal_by_rounding(simulated, recorded.step / recorded.greatest) + 2
    share = recorded.greatest_share if is_cut else 0.0
    is_quiet = np.abs(simulated) < 1e-3 * simulated[top]
    # The recorded pulse may be elsewhere: no pulse either where the simulated one would be quiet at the recorded place.
    place = np.arange(simulated.size) - (int(np.argmax(recorded.mean)) - top)
    is_quiet &= np.where((place >= 0) & (place < simulated.size), is_quiet[place.clip(0, simulated.size - 1)], True)
    before, after = np.flatnonzero(is_quiet[:top]), top + np.flatnonzero(is_quiet[top:])
    quiet = before if before.size >= 8 else after
    offset = error = math.nan
    if quiet.size >= 8:
        difference = recorded.mean[quiet] - simulated[quiet]
        offset, error = float(difference.mean()), float(difference.std(ddof=1)) / math.sqrt(quiet.size)
    cut_off = share >= 0.1
    has_offset = abs(offset) > max(5.0 * error, 1e-3 * float(recorded.mean.max()))
    sentences = []
    if recorded.without_pulse_count:
        sentences.append(
            f"{recorded.without_pulse_count} of {recorded.count} echoes have no pulse (their greatest sample is "
            "below a quarter of the mean's): they lower the mean and have no range; record such echoes under "
            "another label"
        )
    if cut_off:
        sentences.append(
            f"the peak of {100.0 * share:.0f} % of the echoes is cut off at {recorded.greatest:.4g} V, as by an "
            "amplifier or a digitiser beyond its range: peaks, their errors, widths and ranges by constant fraction "
            "are not the echo's; attenuate the signal, or raise the digitiser's range"
        )
    if has_offset:
        size = Quantity(1e3 * offset, 1e3 * covering(recorded.count) * error, "mV")
        sentences.append(
            f"the recorded voltage has an offset, {size.text(signed=True)} where there is no pulse: it adds to "
            "every peak, and moves leading edge and constant fraction; set the instrument's offset to zero, or "
            "subtract it as voltage offset"
        )
    return RecordFaults(share, offset, error, tuple(sentences), cut_off or has_offset)


def _equal_by_rounding(simulated: np.ndarray, step: float) -> int:
    """Return how many samples around the peak a rounding in steps of this share of the peak can make equal."""
    top = int(np.argmax(simulated))
    lower = np.flatnonzero(simulated < simulated[top] * (1.0 - step))
    before, after = lower[lower < top], lower[lower > top]
    return int((after[0] if after.size else simulated.size) - (before[-1] if before.size else -1) - 1)
