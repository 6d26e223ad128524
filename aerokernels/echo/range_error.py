"""Systematic and random error of a range, by Monte Carlo over noise, and the bound that no method can beat.

For a signal v(t) in white Gaussian noise of standard deviation s in each sample, any unbiased estimate of its arrival
time has a variance of at least s^2 / sum (dv/dt)^2 (Cramer-Rao), so that

    range error >= c / 2 * s / sqrt(sum over the samples of (dv/dt)^2)
"""

from dataclasses import dataclass

import numpy as np

from .checks import as_waveform, check_positive
from .pulse_curve import PulseCurve
from .ranging import Template, estimate_range
from .waveform import SPEED_OF_LIGHT


@dataclass(frozen=True)
class RangeStatistics:
    """Errors of a ranging method on one waveform.

    Attributes:
        systematic_error: Mean range minus the true range [m].
        random_error: Standard deviation of the range [m].
        cramer_rao_bound: Least standard deviation of any unbiased range [m].
        systematic_standard_error: Standard error of `systematic_error`, from the number of trials [m].
        random_standard_error: Standard error of `random_error`, from the number of trials [m].
        trial_count: Trials made.
        missed_count: Trials without a range, such as a signal that never crossed the threshold; left out above.
    """

    systematic_error: float
    random_error: float
    cramer_rao_bound: float
    systematic_standard_error: float
    random_standard_error: float
    trial_count: int
    missed_count: int


def cramer_rao_range(time, voltage, noise_rms: float) -> float:
    """Least standard deviation [m] of an unbiased range in white noise.

    Args:
        time: Sample times [s], shape (n,), in even steps.
        voltage: Samples of the signal without noise [V], shape (n,).
        noise_rms: Standard deviation of the noise in each sample [V].

    Raises:
        ValueError: Uneven times, a noise that is not positive, a signal without a slope.
    """
    _, volts, period = as_waveform(time, voltage)
    noise = check_positive(noise_rms, "noise_rms", "V")
    steepness = float(np.linalg.norm(PulseCurve(volts).slope))
    if steepness <= 1e-12 * float(np.abs(volts).max()):  # rounding of the spline on a constant
        raise ValueError("the signal has no slope anywhere, so its arrival time cannot be told: is it a flat line?")
    return 0.5 * SPEED_OF_LIGHT * period * noise / steepness


def range_statistics(
    time,
    voltage,
    method: str,
    *,
    noise_rms: float,
    true_range: float | None = None,
    trial_count: int = 1000,
    seed: int = 0,
    threshold: float | None = None,
    template: Template | None = None,
    fraction: float = 0.5,
) -> RangeStatistics:
    """Systematic and random error of a ranging method in white Gaussian noise.

    Args:
        time: Sample times [s], shape (n,), in even steps.
        voltage: Samples of the signal without noise [V], shape (n,).
        method: As for `estimate_range`.
        noise_rms: Standard deviation of the noise in each sample [V].
        true_range: Range that the systematic error is counted from [m]; None: what the method reads without noise,
            so that the systematic error is what the noise adds.
        trial_count: Noisy waveforms to range, at least two.
        seed: Seed of the noise.
        threshold: As for `estimate_range`.
        template: As for `estimate_range`.
        fraction: As for `estimate_range`.

    Returns:
        The errors. The standard error of the random error assumes normally distributed ranges.

    Raises:
        ValueError: As `estimate_range` for the waveform without noise; also fewer than two trials, or fewer than two
            that gave a range.
    """
    times, volts, _ = as_waveform(time, voltage)
    bound = cramer_rao_range(times, volts, noise_rms)
    if isinstance(trial_count, bool) or not isinstance(trial_count, (int, np.integer)) or trial_count < 2:
        raise ValueError(f"trial_count must be a whole number of at least 2, got {trial_count!r}")

    def read(samples: np.ndarray) -> float:
        return estimate_range(times, samples, method, threshold=threshold, template=template, fraction=fraction)

    clean = read(volts)  # an argument that is wrong shows here, before a trial could pass for a missed one
    generator = np.random.default_rng(seed)
    ranges, missed = [], 0
    for _ in range(trial_count):
        try:
            ranges.append(read(volts + generator.normal(scale=noise_rms, size=volts.size)))
        except ValueError:
            missed += 1
    if len(ranges) < 2:
        raise ValueError(
            f"{missed} of {trial_count} trials gave no range: lower noise_rms ({noise_rms:g} V) or the threshold"
        )
    random_error = float(np.std(ranges, ddof=1))
    return RangeStatistics(
        systematic_error=float(np.mean(ranges)) - (clean if true_range is None else float(true_range)),
        random_error=random_error,
        cramer_rao_bound=bound,
        systematic_standard_error=random_error / float(np.sqrt(len(ranges))),
        random_standard_error=random_error / float(np.sqrt(2.0 * (len(ranges) - 1))),
        trial_count=int(trial_count),
        missed_count=missed,
    )
