"""Compute the mean waveform and the spread of many recorded echoes, in one pass and bounded memory.

A digitiser rounds to steps q. Noise of standard deviation sigma averages the rounding out; what is left of it is about

    q / 2 exp(-2 pi^2 sigma^2 / q^2)

Reference: B. Widrow, I. Kollar, Quantization Noise, Cambridge (2008), chapter 4.
"""

import itertools
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from aerokernels.display.quantities import Quantity
from aerokernels.jobs.recorded import LEAST_SAMPLES, RecordedEcho

# An echo is resampled if its times differ from the mean's by more than this share of a sample period.
SAME_TIME = 1e-6
# The digitiser's step is searched in so many echoes; differences below this share of the peak are rounding errors.
STEP_ECHOES, ROUNDING = 16, 1e-9
# Most echoes, and most samples of them, by which the usual time axis is chosen.
FIRST_ECHOES, FIRST_SAMPLES = 1000, 2**22
# An echo has no pulse if its greatest sample is below this share of the mean's.
LEAST_PULSE = 0.25
COVERAGE = 0.6827  # probability of one standard deviation of a normal distribution
TOLD = 0.95  # least share of the cases in which value and error contain the truth
# Draws for the mean excess of a greatest sample, and errors below the peak within which a sample may be the greatest.
DRAWS, NEAR = 200, 6.0
# Equal greatest samples beyond those that rounding explains from which they are a cut, and the least share of echoes
# that are cut off, or repeated.
MORE_EQUAL, LEAST_SHARE = 2, 0.1
# Share of the simulated peak below which there is no pulse, and the least number of such samples.
NO_PULSE, LEAST_COUNT = 1e-3, 8
# An offset is reported above so many of its standard errors, and above this share of the peak.
OFFSET_SIGMAS, LEAST_OFFSET = 5.0, 1e-3


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
    """Errors of what is read from a mean echo; NaN for a single echo.

    Attributes:
        peak: error of its greatest sample [V], with the mean excess of the greatest of several samples with noise.
        edge_shift: error of the time at which it crosses a level [s]; NaN where the pulse does not.
        lag: error of the lag at which it correlates best with the simulation [s].
    """

    peak: float
    edge_shift: float
    lag: float

    def shifted(self, offset_error: float) -> "MeanErrors":
        """Return the errors with that of a trigger offset [s], which was subtracted from the times."""
        edge_shift, lag = (math.hypot(error, offset_error) for error in (self.edge_shift, self.lag))
        return replace(self, edge_shift=edge_shift, lag=lag)


def mean_errors(
    recorded: AverageEcho, there: np.ndarray, time: np.ndarray, simulated: np.ndarray, level: float
) -> MeanErrors:
    """Compute the errors of a mean echo.

    Args:
        recorded: the mean and its spread.
        there: which of its samples are compared.
        time: their times [s], shape (n,).
        simulated: the simulation at these times [V], shape (n,); not constant.
        level: level of the leading edge [V].
    """
    mean, spread = recorded.mean[there], recorded.spread[there]
    known = np.isfinite(spread)
    error = np.hypot(mean_factor(recorded.count) * recorded.standard_error[there], recorded.rounding)
    top = int(np.argmax(mean))
    slope = np.abs(np.gradient(mean[top] / simulated.max() * simulated, time))
    crossed = np.flatnonzero((mean[1:] >= level) & (mean[:-1] < level))
    edge = math.nan
    if crossed.size:
        at = int(crossed[0]) + int(mean[crossed[0] + 1] - level < level - mean[crossed[0]])
        edge = float(error[at] / slope[at]) if slope[at] > 0.0 else math.nan
    # All samples take part in the lag, so that the few echoes of each need no factor.
    each = np.hypot(recorded.standard_error[there], recorded.rounding)
    return MeanErrors(
        peak=math.hypot(float(error[top]), _excess(simulated * (mean[top] / simulated.max()), error)),
        edge_shift=edge,
        lag=float(np.linalg.norm((slope * each)[known]) / np.sum(slope[known] ** 2)) if known.any() else math.nan,
    )


def _excess(volts: np.ndarray, error: np.ndarray) -> float:
    """Return by how much errors of the samples lift the greatest one on average [V]; NaN where an error is."""
    near = volts > volts.max() - NEAR * error[int(np.argmax(volts))]
    if not near.any():
        return 0.0 if np.isfinite(error[int(np.argmax(volts))]) else math.nan
    volts, error = volts[near], np.nan_to_num(error[near])
    noise = np.random.default_rng(0).standard_normal((DRAWS, volts.size))
    return float((volts + error * noise).max(axis=1).mean()) - float(volts.max())


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
