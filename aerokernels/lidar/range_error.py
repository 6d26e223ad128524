"""Errors of a range: systematic and random ones by simulated noise, and the Cramér-Rao bound.

For a signal v(t) with white Gaussian noise of standard deviation s in each sample, the standard deviation of any
unbiased range is at least c / 2 * s / sqrt(sum over the samples of (dv/dt)^2).
"""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.inputs.checks import as_waveform, check_at_least, check_count, check_positive, check_share
from aerokernels.lidar.pulse_curve import PulseCurve
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
    if true_range is not None:
        true_range = check_at_least(true_range, "true_range")

    reading = Reading(method, threshold, template, fraction)
    clean = reading.range(times, volts)  # a wrong argument raises here instead of counting as missed trials
    reading.warn(volts, period)
    generator = np.random.default_rng(seed)
    return summarise_ranges(
        lambda: volts + generator.normal(scale=noise_rms, size=volts.size),
        partial(reading.range, times),
        trial_count,
        clean if true_range is None else true_range,
        bound,
        confidence,
    )


def summarise_ranges(
    record: Callable[[], np.ndarray],
    read: Callable[[np.ndarray], float],
    trial_count: float,
    true_range: float,
    bound: float,
    confidence: float = 0.95,
) -> RangeStatistics:
    """Read ranges [m] from noisy records, of which a ValueError is one without; return their mean and spread."""
    from scipy.special import gammaincinv, stdtrit  # scipy.stats has them too, and takes a second to import

    trial_count = check_count(trial_count, "trial_count", 2)
    if not 0.0 < check_share(confidence, "confidence") < 1.0:
        raise ValueError(f"confidence must lie between 0 and 1, both excluded, got {confidence!r}")
    ranges = []
    for _ in range(trial_count):
        samples = record()
        with contextlib.suppress(ValueError):  # no range
            ranges.append(read(samples))
    count = len(ranges)
    if count < 2:
        raise ValueError(
            f"{trial_count - count} of {trial_count} trials gave no range: lower the noise, or the threshold"
        )
    systematic, spread = float(np.mean(ranges)) - true_range, float(np.std(ranges, ddof=1))
    standard_error = spread / float(np.sqrt(count))
    reach = float(stdtrit(count - 1, 0.5 * (1.0 + confidence))) * standard_error
    tails = 2.0 * gammaincinv(0.5 * (count - 1), (0.5 * (1.0 + confidence), 0.5 * (1.0 - confidence)))
    low, high = spread * np.sqrt((count - 1) / tails)
    return RangeStatistics(
        systematic_error=systematic,
        random_error=spread,
        cramer_rao_bound=bound,
        systematic_standard_error=standard_error,
        random_standard_error=spread / float(np.sqrt(2.0 * (count - 1))),
        trial_count=trial_count,
        missed_count=trial_count - count,
        confidence=float(confidence),
        systematic_interval=(systematic - reach, systematic + reach),
        random_interval=(float(low), float(high)),
    )
