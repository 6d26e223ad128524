"""Measure the error of a range due to too few samples across a pulse, on a test pulse of the record's own widths.

A test pulse is sampled at eight phases between two samples and ranged by the method; the reference is the reading of
the pulse itself. The test pulse is the template if that is a function. Otherwise it is

    2^(-|t / half width|^p)

on either side of the peak, with the record's half widths before and after the peak. The power p is 2, as of a Gaussian;
more if the record's widths at a fifth and at four fifths of the peak are as close together as those of steep edges; or
1 if its widths near the top indicate a corner. Records with noise have p = 2, because noise itself makes corners. The
record's widths are measured from the same few samples, so the test pulse is narrowed until its samples look as wide as
the record's.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from aerokernels.inputs.checks import warn_caller

from .pulse_curve import PulseCurve
from .waveform import SPEED_OF_LIGHT

PHASE_COUNT = 8
# Widths from few samples misjudge the error by up to a third.
SAFETY = 1.5
# Samples across a pulse's width at half height from which every method reads it correctly and no error is measured: for
# pulses that are Gaussian on either side, and for all others.
ENOUGH_SAMPLES, ENOUGH_OF_ANY = 8.0, 64.0
# Fractions of the peak at which the width shows how steep an edge is, and whether the top is a corner; range of powers
# that count as a Gaussian's, and the greatest power.
FOOT, TOP, GAUSSIAN, STEEPEST = (0.2, 0.8), (0.6, 0.9), (1.6, 2.6), 16.0
# Rms of the record beside its pulse, relative to the peak, above which the record counts as noisy.
NOISE = 2e-3
# Error above which a warning is issued, relative to the pulse's width as a range: 0.45 mm for a width of 10 ns.
TOLERATED = 3e-4
# Samples of the finely sampled test pulse per sample of the record.
_FINE = 32

# (samples, template or None) -> position of arrival [samples].
Reader = Callable[[np.ndarray, Callable | np.ndarray | None], float]


class CoarseSamplingWarning(UserWarning):
    """A record has too few samples across its pulse for the ranging method."""


def half_widths(curve: PulseCurve) -> tuple[float, float] | None:
    """Return the half widths at half the peak, before and after it [samples]; None if the record cuts the pulse."""
    try:
        level = 0.5 * curve.peak
        before, after = curve.peak_position - curve.rise_before_peak(level), curve.fall_after_peak(level)
    except ValueError:
        return None
    return before, after - curve.peak_position


def edge_powers(curve: PulseCurve, before: float, after: float) -> tuple[float, float]:
    """Return the powers p of a record's edges before and after its peak, of these half widths [samples].

    A record with noise has the powers 2.
    """
    position = np.arange(curve.samples.size) - curve.peak_position
    beside = curve.samples[(position < -6.0 * before) | (position > 6.0 * after)]
    if beside.size and float(np.std(beside)) > NOISE * curve.peak:
        return 2.0, 2.0
    found = []
    for steep, top in zip(_powers(curve, *FOOT), _powers(curve, *TOP), strict=True):
        found.append(steep if steep > GAUSSIAN[1] else 1.0 if top < GAUSSIAN[0] else 2.0)
    return found[0], found[1]


def _powers(curve: PulseCurve, low: float, high: float) -> tuple[float, float]:
    """Return the powers p of the edges before and after the peak, from the widths at two fractions of the peak."""
    peak, scale = curve.peak_position, np.log(np.log(low) / np.log(high))
    lower, upper = low * curve.peak, high * curve.peak
    before = (peak - curve.rise_before_peak(lower)) / (peak - curve.rise_before_peak(upper))
    after = (curve.fall_after_peak(lower) - peak) / (curve.fall_after_peak(upper) - peak)
    first, second = (min(float(scale / np.log(max(ratio, 1.01))), STEEPEST) for ratio in (before, after))
    return first, second


def sampling_error(volts: np.ndarray, period: float, read: Reader, template, compensated: bool) -> float:
    """Greatest error [m] of a reading of a record's pulse over the phases of the sampling.

    Args:
        volts: The record, shape (n,).
        period: Sample period [s].
        read: The method: returns the position of arrival [samples] in samples of a pulse, by a template.
        template: The caller's template: a function of time [s], samples, or None.
        compensated: Whether the method subtracts the template's own reading.

    Returns:
        The error; 0 if there are enough samples; NaN if it cannot be measured, for instance for a pulse that is cut.
    """
    curve = PulseCurve(volts)
    sides = half_widths(curve)
    if sides is None:
        return float("nan")
    before, after = sides
    if before + after >= (ENOUGH_SAMPLES if callable(template) else ENOUGH_OF_ANY):
        return 0.0
    try:
        steep = (2.0, 2.0) if callable(template) else edge_powers(curve, before, after)
    except ValueError:  # the record cuts the foot of the pulse
        steep = (2.0, 2.0)
    if before + after >= ENOUGH_SAMPLES and steep == (2.0, 2.0):
        return 0.0
    peak = curve.peak
    reach = int(8.0 * (before + after)) + 16

    def pulse(position: np.ndarray, narrower: float = 1.0) -> np.ndarray:
        if callable(template):
            top = float(np.max(template(np.linspace(-reach, reach, 2 * reach * _FINE + 1) * period)))
            return peak / top * np.asarray(template(position * period), dtype=np.float64)
        side = np.where(position < 0.0, before, after)
        return peak * np.exp2(-(np.abs(position / (narrower * side)) ** np.where(position < 0.0, *steep)))

    whole = np.arange(-reach, reach + 1, dtype=np.float64)
    phases = np.arange(PHASE_COUNT) / PHASE_COUNT
    widths = [sum(half_widths(PulseCurve(pulse(whole - phase))) or (0.0,)) for phase in phases]
    pulse = partial(pulse, narrower=min(1.0, (before + after) / max(max(widths), 1e-9)))
    given = pulse(whole) if isinstance(template, np.ndarray) else template
    try:
        fine = np.arange(-reach * _FINE, reach * _FINE + 1) / _FINE
        truth = 0.0 if given is not None and compensated else read(pulse(fine), None) / _FINE - reach
    except ValueError:
        return float("nan")
    errors = []
    for phase in phases:
        try:
            errors.append(read(pulse(whole - phase), given) - reach - phase - truth)
        except ValueError:  # a threshold above the greatest sample, say
            continue
    return SAFETY * 0.5 * SPEED_OF_LIGHT * period * float(np.abs(errors).max()) if errors else float("nan")


def warn_of_sampling(volts: np.ndarray, period: float, method: str, error: float, shape_given: bool) -> None:
    """Warn that a reading has an error of up to `error` [m], if the error exceeds the tolerated one."""
    sides = half_widths(PulseCurve(volts))
    if sides is None or not error > TOLERATED * 0.5 * SPEED_OF_LIGHT * period * sum(sides):
        return
    remedy = "" if shape_given else ", or give the pulse's shape as template (a function of time)"
    warn_caller(
        f"the record has {sum(sides):.2g} samples across its pulse, too few for method {str(method)!r}: the pulse's "
        f"place between the samples moves the range by up to {1e3 * error:.2g} mm; sample faster{remedy}",
        CoarseSamplingWarning,
    )
