"""Warn of records whose range is doubtful: too few samples across the pulse, or a peak that is cut off.

The error due to too few samples is measured: a test pulse is sampled at eight phases between two samples and ranged by
the method; the reference is the reading of the pulse itself. The test pulse is the template if that is a function.
Otherwise it is a Gaussian on either side of the peak, with the record's half widths before and after it. These are
measured from the same few samples, so the test pulse is narrowed until its samples look as wide as the record's.

A peak counts as cut off by an amplifier or a digitiser if its samples are equal, or level within the noise beside the
pulse over more of the pulse's width than those of a rounded pulse are. All methods but the leading edge then read
another time than that of the whole pulse.
"""

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from aerokernels.inputs.checks import warn_caller
from aerokernels.lidar.pulse_curve import PLATEAU, PulseCurve, Shape
from aerokernels.lidar.pulses import SPEED_OF_LIGHT

# Samples across a pulse's width at half height from which every method reads it correctly and no error is measured.
ENOUGH_SAMPLES = 8.0
# Samples of the finely sampled test pulse per sample of the record.
_FINE = 32

# (samples, template or None) -> position of arrival [samples].
Reader = Callable[[np.ndarray, Callable | np.ndarray | None], float]


class CoarseSamplingWarning(UserWarning):
    """A record has too few samples across its pulse for the ranging method."""


class SaturatedRecordWarning(UserWarning):
    """A record's peak is cut off, and the ranging method depends on the peak."""


def half_widths(curve: PulseCurve) -> tuple[float, float] | None:
    """Return the half widths at half the peak, before and after it [samples]; None if the record cuts the pulse."""
    try:
        level = 0.5 * curve.peak
        before, after = curve.peak_position - curve.rise_before_peak(level), curve.fall_after_peak(level)
    except ValueError:
        return None
    return before, after - curve.peak_position


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
        return math.nan
    before, after = sides
    if before + after >= ENOUGH_SAMPLES:
        return 0.0
    peak, reach = curve.peak, int(8.0 * (before + after)) + 16

    def pulse(position: np.ndarray, narrower: float = 1.0) -> np.ndarray:
        if callable(template):
            top = float(np.max(template(np.linspace(-reach, reach, 2 * reach * _FINE + 1) * period)))
            return peak / top * np.asarray(template(position * period), dtype=np.float64)
        side = np.where(position < 0.0, before, after)
        return peak * np.exp2(-(np.abs(position / (narrower * side)) ** 2.0))

    whole = np.arange(-reach, reach + 1, dtype=np.float64)
    phases = np.arange(8) / 8
    widths = [sum(half_widths(PulseCurve(pulse(whole - phase))) or (0.0,)) for phase in phases]
    pulse = partial(pulse, narrower=min(1.0, (before + after) / max(max(widths), 1e-9)))
    same = pulse(whole) if isinstance(template, np.ndarray) else template
    try:
        fine = np.arange(-reach * _FINE, reach * _FINE + 1) / _FINE
        truth = 0.0 if same is not None and compensated else read(pulse(fine), None) / _FINE - reach
    except ValueError:
        return math.nan
    errors = []
    for phase in phases:
        try:
            errors.append(read(pulse(whole - phase), same) - reach - phase - truth)
        except ValueError:  # a threshold above the greatest sample, say
            continue
    # Widths from few samples misjudge the error by up to a third.
    return 1.5 * 0.5 * SPEED_OF_LIGHT * period * float(np.abs(errors).max()) if errors else math.nan


def warn_of_sampling(volts: np.ndarray, period: float, method: str, error: float, shape_given: bool) -> None:
    """Warn that a reading has an error of up to `error` [m], if that is above 3e-4 of the pulse's width as a range."""
    sides = half_widths(PulseCurve(volts))
    if sides is None or not error > 3e-4 * 0.5 * SPEED_OF_LIGHT * period * sum(sides):
        return
    remedy = "" if shape_given else ", or give the pulse's shape as template (a function of time)"
    warn_caller(
        f"the record has {sum(sides):.2g} samples across its pulse, too few for method {str(method)!r}: the pulse's "
        f"place between the samples moves the range by up to {1e3 * error:.2g} mm; sample faster{remedy}",
        CoarseSamplingWarning,
    )


def warn_of_saturation(volts: np.ndarray, period: float, method: str, shape: Shape | None) -> bool:
    """Warn if a record's peak is cut off; return whether a warning was issued.

    Args:
        volts: The record, shape (n,).
        period: Sample period [s].
        method: Name of the ranging method.
        shape: The pulse as a function of time [s], if it is known: its own top may be flat.
    """
    cut = cut_samples(volts, shape, period)
    if cut.stop == cut.start:
        return False
    warn_caller(
        f"the {cut.stop - cut.start} samples at the record's peak are equal or level, as if an amplifier or digitiser "
        f"saturated at {float(np.median(volts[cut])):.4g} V: if the pulse goes on above them, method {method!r} "
        "misreads it; attenuate the signal, raise the digitiser's range, or take 'leading-edge'",
        SaturatedRecordWarning,
    )
    return True


def cut_samples(volts: np.ndarray, shape: Shape | None = None, period: float = 1.0) -> slice:
    """Return the samples of a record's peak that are cut off; none for a whole peak. Arguments as above."""
    top = int(np.argmax(volts))
    level = float(volts[top])
    if not level > 0.0:
        return slice(0, 0)
    equal, above = _run(volts == level, top), _run(volts >= 0.5 * level, top)
    if _length(equal) >= PLATEAU:
        return equal if _length(equal) > _rounded(0.0, above, shape, period) + 1.0 else slice(0, 0)
    width = max(1, _length(above) // 6)  # of the running mean which reduces the noise
    smooth = np.convolve(volts, np.full(width, 1.0 / width), "same")
    top = above.start + int(np.argmax(smooth[above]))
    # A plateau lies within six standard deviations of the noise and is 1.6 times as wide as a rounded pulse there.
    depth = max(1e-3 * level, 6.0 * _noise(smooth, above))
    flat = _run(smooth >= smooth[top] - depth, top)
    wide = 1.6 * _rounded(depth / level, above, shape, period) + 2.0
    return flat if depth < 0.25 * level and _length(flat) > max(wide, PLATEAU) else slice(0, 0)


def _run(these: np.ndarray, place: int) -> slice:
    """Return the neighbours of a sample for which a condition holds without a gap."""
    others = np.flatnonzero(~these)
    before, after = others[others < place], others[others > place]
    return slice(int(before[-1]) + 1 if before.size else 0, int(after[0]) if after.size else these.size)


def _length(part: slice) -> int:
    return int(part.stop - part.start)


def _rounded(depth: float, above: slice, shape: Shape | None, period: float) -> float:
    """Return how many samples of a pulse lie within a share of its peak; it is Gaussian if its shape is not known."""
    if shape is None:
        return _length(above) * math.sqrt(depth / math.log(2.0))
    reach = 2 * _length(above)
    own = np.asarray(shape(np.arange(-reach, reach + 1) * period), dtype=np.float64)
    return float(np.count_nonzero(own >= own.max() * (1.0 - max(depth, 1e-12))))


def _noise(volts: np.ndarray, above: slice) -> float:
    """Return the standard deviation beside the pulse, by the median of deviations; 0 if few samples are beside it."""
    place, reach = np.arange(volts.size), 2 * _length(above)
    beside = volts[(place < above.start - reach) | (place >= above.stop + reach)]
    return 1.4826 * float(np.median(np.abs(beside - np.median(beside)))) if beside.size >= 8 else 0.0
