"""Errors of a range: systematic and random ones by simulated noise, the Cramér-Rao bound, the walk of a threshold.

For a signal v(t) with white Gaussian noise of standard deviation s in each sample, any unbiased estimate of its arrival
time has a variance of at least s^2 / sum (dv/dt)^2 (Cramer-Rao), so that

    range error >= c / 2 * s / sqrt(sum over the samples of (dv/dt)^2)

A higher pulse crosses a threshold T earlier: the range walk. For a Gaussian of peak V and 1/e half-width tau the
crossing is tau sqrt(ln(V / T)) before the peak, so its range is short by c tau sqrt(ln(V / T)) / 2. For other pulses
the curve is measured: the waveform is scaled to a series of amplitudes, each of which is ranged.
"""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.inputs.checks import as_waveform, check_at_least, check_count, check_positive, check_share
from aerokernels.lidar.chain import DetectorChain
from aerokernels.lidar.pulse_curve import PulseCurve, peak_height
from aerokernels.lidar.pulses import SPEED_OF_LIGHT
from aerokernels.lidar.ranging import Reading, Template


@dataclass(frozen=True)
class RangeStatistics:
    """Errors of a ranging method on one waveform.

    Attributes:
        systematic_error: Mean range minus the true range [m].
        random_error: Standard deviation of the range [m].
        cramer_rao_bound: Least standard deviation of any unbiased range [m].
        systematic_standard_error: Standard error of `systematic_error`, from the number of trials [m].
        random_standard_error: Standard error of `random_error`, from the number of trials [m].
        trial_count: Number of trials.
        missed_count: Trials without a range, such as a signal that never crossed the threshold; left out of the errors.
        confidence: Probability that each of the intervals below contains its quantity.
        systematic_interval: Confidence interval of `systematic_error` [m], Student's t.
        random_interval: Confidence interval of `random_error` [m], chi-squared.
    """

    systematic_error: float
    random_error: float
    cramer_rao_bound: float
    systematic_standard_error: float
    random_standard_error: float
    trial_count: int
    missed_count: int
    confidence: float = 0.95
    systematic_interval: tuple[float, float] = (float("nan"), float("nan"))
    random_interval: tuple[float, float] = (float("nan"), float("nan"))


@checked
def cramer_rao_range(time: Numbers, voltage: Numbers, noise_rms: float) -> float:
    """Cramér-Rao bound: the least standard deviation [m] of an unbiased range in white noise.

    Args:
        time: Sample times [s], shape (n,), in even steps.
        voltage: Samples of the signal without noise [V], shape (n,).
        noise_rms: Standard deviation of the noise in each sample [V].

    Raises:
        ValueError: Uneven times, a noise that is not positive, a signal that is constant.
    """
    _, volts, period = as_waveform(time, voltage)
    noise = check_positive(noise_rms, "noise_rms", "V")
    steepness = float(np.linalg.norm(PulseCurve(volts).slope))
    if steepness <= 1e-12 * float(np.abs(volts).max()):  # rounding of the spline on a constant
        raise ValueError("the signal is constant, so its arrival time is not defined")
    return 0.5 * SPEED_OF_LIGHT * period * noise / steepness


@checked
def range_statistics(
    time: Numbers,
    voltage: Numbers,
    method: str,
    *,
    noise_rms: float,
    true_range: float | None = None,
    trial_count: int = 1000,
    seed: int = 0,
    threshold: float | None = None,
    template: Template | None = None,
    fraction: float = 0.5,
    confidence: float = 0.95,
) -> RangeStatistics:
    """Measure the systematic and random error of a ranging method in white Gaussian noise.

    Args:
        time: Sample times [s], shape (n,), in even steps.
        voltage: Samples of the signal without noise [V], shape (n,).
        method: As for `estimate_range`.
        noise_rms: Standard deviation of the noise in each sample [V].
        true_range: Reference of the systematic error [m]; None: the method's reading without noise, so that the
            systematic error is that due to the noise.
        trial_count: Noisy waveforms to range, at least two.
        seed: Seed of the noise.
        threshold: As for `estimate_range`.
        template: As for `estimate_range`.
        fraction: As for `estimate_range`.
        confidence: Probability of the confidence intervals, between 0 and 1.

    Warns:
        CoarseSamplingWarning, SaturatedRecordWarning: As for `estimate_range`.

    Returns:
        The errors. Standard error and interval of the random error assume normally distributed ranges.

    Raises:
        ValueError: As `estimate_range` for the waveform without noise; also fewer than two trials, or fewer than two
            that gave a range.
    """
    times, volts, period = as_waveform(time, voltage)
    bound = cramer_rao_range(times, volts, noise_rms)
    trial_count = check_trials(trial_count, confidence)
    if true_range is not None:
        true_range = check_at_least(true_range, "true_range")

    reading = Reading(method, threshold, template, fraction)
    clean = reading.range(times, volts)  # a wrong argument raises here instead of counting as missed trials
    reading.warn(volts, period)
    generator = np.random.default_rng(seed)
    ranges = _trials(
        partial(reading.range, times),
        lambda: volts + generator.normal(scale=noise_rms, size=volts.size),
        trial_count,
    )
    return summarise_ranges(ranges, trial_count, clean if true_range is None else true_range, bound, confidence)


@checked
def chain_range_statistics(
    chain: DetectorChain,
    time: Numbers,
    power: Numbers,
    read: Callable[[np.ndarray, np.ndarray], float],
    *,
    true_range: float,
    stride: int = 1,
    trial_count: int = 1000,
    seed: int = 0,
    confidence: float = 0.95,
) -> RangeStatistics:
    """Measure the systematic and random error of a rangefinder behind a detector chain.

    Args:
        chain: The chain; every record passes its noise, saturation and digitiser.
        time: Times [s], shape (n,), in even steps fine enough for the pulse and the low-pass.
        power: Received power [W], shape (n,).
        read: Returns the range [m] from sample times [s] and samples [V]; an echo for which it raises ValueError counts
            as missed.
        true_range: The range by the geometry [m].
        stride: Number of given times per sample.
        trial_count: Records to range, at least two.
        seed: Seed of the noise.
        confidence: Probability of the confidence intervals, between 0 and 1.

    Returns:
        The errors. The bound is that of the current ahead of the low-pass, see `DetectorChain.cramer_rao_range`.

    Raises:
        ValueError: Arguments out of range, or fewer than two trials that gave a range.
    """
    times, watts, _ = as_waveform(time, power)
    trial_count = check_trials(trial_count, confidence)
    distance = check_at_least(true_range, "true_range")
    bound = chain.cramer_rao_range(times, watts)
    generator = np.random.default_rng(seed)
    ranges = _trials(
        lambda samples: read(times[::stride], samples),
        lambda: chain.record(times, watts, generator, stride),
        trial_count,
    )
    return summarise_ranges(ranges, trial_count, distance, bound, confidence)


def check_trials(trial_count: float, confidence: float) -> int:
    """Return the number of trials, at least two; check that the confidence is between 0 and 1.

    Raises:
        ValueError: One of them is out of range.
    """
    trial_count = check_count(trial_count, "trial_count", 2)
    if not 0.0 < check_share(confidence, "confidence") < 1.0:
        raise ValueError(f"confidence must lie between 0 and 1, both excluded, got {confidence!r}")
    return trial_count


def _trials(read: Callable[[np.ndarray], float], record: Callable[[], np.ndarray], trial_count: int) -> list[float]:
    """Return the ranges [m] of those records that gave one."""
    ranges = []
    for _ in range(trial_count):
        samples = record()
        with contextlib.suppress(ValueError):
            ranges.append(read(samples))
    return ranges


def summarise_ranges(
    ranges: list[float], trial_count: int, true_range: float, bound: float, confidence: float
) -> RangeStatistics:
    """Return mean and spread of the ranges [m] of trials, with their confidence intervals.

    Raises:
        ValueError: Fewer than two ranges.
    """
    from scipy.special import gammaincinv, stdtrit  # scipy.stats has them too, and takes a second to import

    found = len(ranges)
    if found < 2:
        raise ValueError(
            f"{trial_count - found} of {trial_count} trials gave no range: lower the noise, or the threshold"
        )
    systematic, spread = float(np.mean(ranges)) - true_range, float(np.std(ranges, ddof=1))
    standard_error = spread / float(np.sqrt(found))
    reach = float(stdtrit(found - 1, 0.5 * (1.0 + confidence))) * standard_error
    tails = 2.0 * gammaincinv(0.5 * (found - 1), (0.5 * (1.0 + confidence), 0.5 * (1.0 - confidence)))
    low, high = spread * np.sqrt((found - 1) / tails)
    return RangeStatistics(
        systematic_error=systematic,
        random_error=spread,
        cramer_rao_bound=bound,
        systematic_standard_error=standard_error,
        random_standard_error=spread / float(np.sqrt(2.0 * (found - 1))),
        trial_count=int(trial_count),
        missed_count=trial_count - found,
        confidence=float(confidence),
        systematic_interval=(systematic - reach, systematic + reach),
        random_interval=(float(low), float(high)),
    )


# The curve's points are evenly spaced in sqrt(ln(V / T)), in which the walk of a Gaussian is a straight line.
POINT_COUNT = 128
LEAST_RATIO, GREATEST_RATIO = 1.0005, 1000.0


@dataclass(frozen=True, eq=False)
class RangeWalk:
    """Error of a leading-edge range as a function of the pulse's height.

    Attributes:
        threshold: Level of the discriminator [V].
        peak: Peaks of the echo [V], increasing, shape (n,).
        error: Range by the threshold minus the range by the time of the peak [m], shape (n,); negative, decreasing.
    """

    threshold: float
    peak: np.ndarray
    error: np.ndarray

    @checked
    def at_peak(self, peak: float) -> float:
        """Return the error [m] of an echo of this peak [V].

        Raises:
            ValueError: The peak is outside the curve.
        """
        from scipy.interpolate import PchipInterpolator

        volts = check_positive(peak, "peak", "V")
        if not self.peak[0] <= volts <= self.peak[-1]:
            raise ValueError(
                f"a peak of {volts:g} V is outside the range walk curve, {self.peak[0]:g} to {self.peak[-1]:g} V: "
                "lower or raise the threshold"
            )
        at = PchipInterpolator(_stretched(self.peak / self.threshold), self.error)
        return float(at(_stretched(volts / self.threshold)))

    @checked
    def correct(self, time: Numbers, voltage: Numbers, reading: float, *, peak: float | None = None) -> float:
        """Subtract from a leading-edge range [m] the error of an echo of this waveform's peak.

        Args:
            time: Sample times [s], shape (n,), in even steps.
            voltage: Samples [V], shape (n,).
            reading: The leading-edge range [m].
            peak: Height of the pulse [V], if it is known better than from the samples.

        Raises:
            ValueError: A peak outside the curve, a waveform without a peak.
        """
        _, volts, _ = as_waveform(time, voltage)
        return check_at_least(reading, "reading") - self.at_peak(peak_height(volts) if peak is None else peak)


def _stretched(ratio):
    return np.sqrt(np.log(ratio))


@checked
def range_walk(time: Numbers, voltage: Numbers, threshold: float) -> RangeWalk:
    """Compute the range walk curve of a threshold for pulses of one shape.

    Args:
        time: Sample times of a clean pulse [s], shape (n,), in even steps.
        voltage: Its samples [V], shape (n,), of any height.
        threshold: Level of the discriminator [V].

    Returns:
        The curve, for peaks from just above the threshold to 1000 times the threshold; up to lower peaks if the record
        cuts the pulse off before it has fallen to a thousandth.

    Raises:
        ValueError: Uneven times, no pulse, or a pulse that is cut off at half its height.
    """
    _, volts, period = as_waveform(time, voltage)
    level = check_positive(threshold, "threshold", "V")
    curve = PulseCurve(volts)
    ends = max(float(volts[0]), float(volts[-1]), 0.0) / curve.peak
    greatest = min(GREATEST_RATIO, 0.999 / ends) if ends > 0.0 else GREATEST_RATIO
    if greatest < 2.0:
        raise ValueError("the record cuts the pulse off above half its height: begin it earlier or end it later")
    ratios = np.exp(np.square(np.linspace(_stretched(LEAST_RATIO), _stretched(greatest), POINT_COUNT)))
    rises = np.array([curve.first_rise(curve.peak / ratio) for ratio in ratios])
    error = 0.5 * SPEED_OF_LIGHT * period * (rises - curve.peak_position)
    return RangeWalk(level, level * ratios, error)
