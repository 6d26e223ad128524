"""Compare a recorded waveform with a simulated one.

The correlation is eq 13-14 of the paper, one number r (Pearson's), at zero lag and at the lag where it is greatest. A
small r with a small peak error indicates two records that are not aligned in time. Both conventions of the peak error
are given, because the paper's own figures mix them. Pulses of different shape correlate highly, too (Gaussians of 6 and
10 ns: 0.93), although their edges do not coincide. The widths of the pulses are therefore compared separately.
"""

import math
from dataclasses import dataclass

import numpy as np

from aerokernels.display.shown import shown
from aerokernels.inputs.arguments import GREAT, SMALL, Numbers, checked
from aerokernels.inputs.checks import as_finite_array, as_waveform, check_at_least, check_positive
from aerokernels.lidar.pulse_curve import PulseCurve
from aerokernels.lidar.pulses import SPEED_OF_LIGHT

# Table 5, made half-open: a degree holds for |r| from its own bound up to, but not at, the next.
DEGREES = (
    (0.8, "highly correlated"),
    (0.5, "significant correlation"),
    (0.3, "real correlation"),
    (0.0, "micro correlation"),
)
LEAST_OVERLAP = 8  # any two pulses look alike if fewer samples than this overlap
WIDTH_SHARES = (0.25, 0.5, 0.75)  # fractions of the peak at which widths are compared


@shown
@dataclass(frozen=True)
class WaveformComparison:
    """Similarities and differences of two waveforms.

    Attributes:
        recorded_peak: Greatest recorded sample [V].
        simulated_peak: Greatest simulated sample [V].
        peak_error: (recorded - simulated) / simulated peak, the convention of Table 4.
        peak_error_of_recorded: (recorded - simulated) / recorded peak, the other convention.
        correlation: r at zero lag, -1 to 1.
        best_correlation: Greatest r over the lags tried.
        lag: Lag of that r [s]; positive: the recorded waveform is the later one.
        degree: Degree of correlation by Table 5, from r at zero lag.
        best_degree: Degree of correlation by Table 5, from the greatest r.
        edge_level: Level at which the leading edges were compared [V].
        edge_shift: Recorded minus simulated time of the first rise through that level [s]; NaN if one of the waveforms
            has no such rise.
        range_difference: Recorded minus simulated range of a rangefinder with that fixed threshold [m].
        recorded_width: Width of the recorded pulse at half of its own peak [s]; NaN if the record does not contain it.
        simulated_width: Width of the simulated pulse at half of its own peak [s]; NaN if the record does not contain
            it.
        same_pulse: Whether both pulses have the same shape: their widths at a quarter, half and three quarters of their
            peaks agree to a hundredth, or to their noise. False: `edge_shift` and `range_difference` are due to the
            pulses, not to the target. None if the record is too short or too noisy to decide.
    """

    recorded_peak: float
    simulated_peak: float
    peak_error: float
    peak_error_of_recorded: float
    correlation: float
    best_correlation: float
    lag: float
    degree: str
    best_degree: str
    edge_level: float
    edge_shift: float
    range_difference: float
    recorded_width: float = math.nan
    simulated_width: float = math.nan
    same_pulse: bool | None = None

    @property
    def width_range(self) -> float:
        """Effect of the difference of the widths at half height on a range read from the leading edge there [m]."""
        return 0.25 * SPEED_OF_LIGHT * (self.recorded_width - self.simulated_width)


@checked
def correlation_degree(correlation: float) -> str:
    """Return the degree of correlation by Table 5: |r| in [0, 0.3), [0.3, 0.5), [0.5, 0.8), [0.8, 1].

    Raises:
        ValueError: r is outside -1 to 1, or NaN.
    """
    size = abs(float(correlation))
    if not size <= 1.0 + 1e-9:
        raise ValueError(f"a correlation coefficient lies between -1 and 1, got {correlation!r}")
    return next(name for bound, name in DEGREES if size >= bound)


@checked
def pearson_correlation(first: Numbers, second: Numbers) -> float:
    """Return Pearson's r of two lists of one length (eq 13-14).

    Raises:
        ValueError: Shapes that disagree, fewer than two samples, or a list that is constant.
    """
    a, b = as_finite_array(first, "first waveform"), as_finite_array(second, "second waveform")
    if a.shape != b.shape or a.ndim != 1 or a.size < 2:
        raise ValueError(f"a correlation needs two lists of one length, got shapes {a.shape} and {b.shape}")
    deviations = []
    for values, name in ((a, "first"), (b, "second")):
        scale = float(np.abs(values).max())
        deviation = (values - values.mean()) / (scale or 1.0)
        if np.linalg.norm(deviation) <= 1e-14 * math.sqrt(values.size):
            raise ValueError(f"the {name} waveform is constant: its correlation is not defined")
        deviations.append(deviation / np.linalg.norm(deviation))
    return float(np.clip(deviations[0] @ deviations[1], -1.0, 1.0))


def correlation_by_lag(recorded: np.ndarray, simulated: np.ndarray, greatest_shift: int) -> np.ndarray:
    """Return Pearson's r over the overlap, for shifts -greatest_shift to greatest_shift of the recorded waveform.

    Entry `greatest_shift + k` compares recorded[i + k] with simulated[i]; NaN if the overlapping part of either is
    constant. The shifts are in samples, and less than n - 1.
    """
    from scipy.signal import correlate

    count = recorded.size
    # One mean and one scale for the whole record keep the sums below well conditioned; r does not depend on them.
    a = (recorded - recorded.mean()) / max(float(np.ptp(recorded)), np.finfo(np.float64).tiny)
    b = (simulated - simulated.mean()) / max(float(np.ptp(simulated)), np.finfo(np.float64).tiny)
    shifts = np.arange(-greatest_shift, greatest_shift + 1)
    begin, end = np.maximum(shifts, 0), np.minimum(shifts, 0) + count  # the overlapping part of `recorded`

    def sums(values: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        running = np.concatenate([[0.0], np.cumsum(values)])
        return running[high] - running[low]

    common = (end - begin).astype(np.float64)
    product = correlate(a, b, mode="full", method="auto")[count - 1 + shifts]
    sum_a, sum_aa = sums(a, begin, end), sums(a * a, begin, end)
    sum_b, sum_bb = sums(b, begin - shifts, end - shifts), sums(b * b, begin - shifts, end - shifts)
    spread_a, spread_b = sum_aa - sum_a**2 / common, sum_bb - sum_b**2 / common
    # Below this the difference of sums is rounding error: the overlapping part is constant.
    floor = 1e-12 * count
    with np.errstate(invalid="ignore", divide="ignore"):
        r = (product - sum_a * sum_b / common) / np.sqrt(spread_a * spread_b)
    return np.where((spread_a > floor) & (spread_b > floor), np.clip(r, -1.0, 1.0), np.nan)


@checked
def compare_waveforms(
    time: Numbers,
    recorded: Numbers,
    simulated: Numbers,
    *,
    greatest_lag: float | None = None,
    threshold: float | None = None,
    rounding: float = 0.0,
) -> WaveformComparison:
    """Compare a recorded waveform with a simulated one.

    Args:
        time: Sample times of both [s], shape (n,), in even steps.
        recorded: Recorded samples [V], shape (n,).
        simulated: Simulated samples [V], shape (n,).
        greatest_lag: Largest lag tried either way [s]; None: half the record, or the distance of the two peaks where
            they are farther apart. Only overlapping samples count.
        threshold: Level at which the leading edges are compared [V]; None: half of the lower peak. One level for both,
            as for a fixed discriminator, so that a lower pulse counts as later.
        rounding: Greatest error of a recorded sample beside its noise [V], such as half a step of the digitiser. Pulses
            whose widths differ by no more than that explains are the same.

    Returns:
        Peak errors in both conventions, r at zero lag, the greatest r and its lag (between samples: the vertex of the
        parabola through the three samples around it), the degrees of Table 5, the shift of the leading edge and the
        corresponding difference of range.

    Raises:
        ValueError: Shapes that disagree, fewer than 16 samples, uneven times, numbers that are not finite, a waveform
            that is constant or has no positive peak, a lag or threshold that is not positive, a negative rounding.
        TypeError: Values that are not real numbers.
    """
    test, period = _samples(time, recorded, "recorded")
    model, _ = _samples(time, simulated, "simulated")
    test_peak, model_peak = float(test.max()), float(model.max())
    for name, peak in (("recorded", test_peak), ("simulated", model_peak)):
        if peak <= 0.0:
            raise ValueError(
                f"the {name} waveform has no positive peak (greatest sample {peak:g} V): is its sign inverted?"
            )
        if not SMALL < peak < GREAT:
            raise ValueError(f"the {name} waveform peaks at {peak:g} V, which is out of all proportion: give volts")
    r = pearson_correlation(test, model)
    if greatest_lag is None:  # noise moves the greatest samples
        shift = max(test.size // 2, abs(int(np.argmax(test)) - int(np.argmax(model))) + LEAST_OVERLAP)
    else:
        shift = math.ceil(check_positive(greatest_lag, "greatest_lag", "s") / period)
    shift = min(shift, test.size - LEAST_OVERLAP)
    by_lag = correlation_by_lag(test, model, shift)
    by_lag[shift] = r
    position, best = _vertex(by_lag)
    best = min(max(best, r), 1.0)
    level = 0.5 * min(test_peak, model_peak) if threshold is None else check_positive(threshold, "threshold", "V")
    edge_shift = (_edge(test, level) - _edge(model, level)) * period
    widths = np.array([_widths(test), _widths(model)])
    half = WIDTH_SHARES.index(0.5)
    noise = math.hypot(_noise(test - model), check_at_least(rounding, "rounding", 0.0))
    return WaveformComparison(
        recorded_peak=test_peak,
        simulated_peak=model_peak,
        peak_error=(test_peak - model_peak) / model_peak,
        peak_error_of_recorded=(test_peak - model_peak) / test_peak,
        correlation=r,
        best_correlation=best,
        lag=(position - shift) * period,
        degree=correlation_degree(r),
        best_degree=correlation_degree(best),
        edge_level=level,
        edge_shift=edge_shift,
        range_difference=0.5 * SPEED_OF_LIGHT * edge_shift,
        recorded_width=float(widths[0, half]) * period,
        simulated_width=float(widths[1, half]) * period,
        same_pulse=_same_widths(widths[0], widths[1], noise / test_peak, model / model_peak),
    )


def _samples(time: Numbers, voltage: Numbers, name: str) -> tuple[np.ndarray, float]:
    """Return samples [V] and their period [s]; a ValueError says which of the two waveforms it is about."""
    try:
        _, samples, period = as_waveform(time, voltage, least_count=2 * LEAST_OVERLAP)
    except ValueError as error:
        raise ValueError(f"the {name} waveform: {error}") from None
    if samples.min() == samples.max() and samples.max() > 0.0:
        raise ValueError(f"the {name} waveform is constant: its correlation is not defined")
    return samples, period


def _edge(samples: np.ndarray, level: float) -> float:
    """Return the position of the first rise through `level` [samples]; NaN if there is none."""
    try:
        return PulseCurve(samples).first_rise(level)
    except ValueError:
        return math.nan


def _widths(samples: np.ndarray) -> list[float]:
    """Return widths [samples] at WIDTH_SHARES of the peak; NaN if the record does not contain both sides of one."""
    curve, result = PulseCurve(samples), []
    for share in WIDTH_SHARES:
        try:
            level = share * curve.peak
            is_complete = samples[0] < level and samples[-1] < level
            result.append(curve.fall_after_peak(level) - curve.rise_before_peak(level) if is_complete else math.nan)
        except ValueError:  # the peak is at an end of the record
            result.append(math.nan)
    return result


def _same_widths(recorded: np.ndarray, simulated: np.ndarray, noise: float, model: np.ndarray) -> bool | None:
    """Return whether widths at WIDTH_SHARES agree; `noise` and the samples `model` are relative to their peaks.

    None if that cannot be decided. Noise at a level moves each of its crossings by noise / slope; noise at the peak
    moves the level by its fraction of the peak.
    """
    known = np.isfinite(recorded) & np.isfinite(simulated)
    if not known.any() or noise > 0.05:  # of the peak: a level is crossed repeatedly
        return None
    curve = PulseCurve(model)
    for share, first, second in zip(np.array(WIDTH_SHARES)[known], recorded[known], simulated[known], strict=True):
        level = share * curve.peak
        crossings = curve.rise_before_peak(level), curve.fall_after_peak(level)
        per_level = 1.0 / np.abs(curve.spline.derivative()(np.array(crossings)))
        error = noise * math.hypot(*per_level, share * per_level.sum())
        # Noise alone exceeds five standard errors once in a million records.
        if abs(first - second) > max(0.01 * second, 5.0 * error):
            return False
    return True


def _noise(difference: np.ndarray) -> float:
    """Return the standard deviation of white noise on a smooth curve, from fourth differences (sqrt(70) times it)."""
    return 1.4826 * float(np.median(np.abs(np.diff(difference, 4)))) / math.sqrt(70.0)


def _vertex(values: np.ndarray) -> tuple[float, float]:
    """Return position and height of the greatest value, refined by the parabola through it and its neighbours."""
    top = int(np.nanargmax(values))
    height = float(values[top])
    if 0 < top < values.size - 1 and np.isfinite(values[top - 1 : top + 2]).all():
        before, after = float(values[top - 1]), float(values[top + 1])
        bend = before - 2.0 * height + after
        if bend < 0.0:
            move = 0.5 * (before - after) / bend
            return top + move, height - 0.25 * (before - after) * move
    return float(top), height
