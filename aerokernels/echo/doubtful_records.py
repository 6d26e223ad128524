"""Warn of records whose range is doubtful: too few samples across the pulse, or a peak that is cut off.

The error due to too few samples is measured: a test pulse is sampled at eight phases between two samples and ranged by
the method; the reference is the reading of the pulse itself. The test pulse is the template if that is a function.
Otherwise it is

    2^(-|t / half width|^p)

on either side of the peak, with the record's half widths before and after the peak. The power p is 2, as of a Gaussian;
more if the record's widths at a fifth and at four fifths of the peak are as close together as those of steep edges; or
1 if its widths near the top indicate a corner. Records with noise have p = 2, because noise itself makes corners. The
record's widths are measured from the same few samples, so the test pulse is narrowed until its samples look as wide as
the record's.

A peak counts as cut off by an amplifier or a digitiser if its samples are equal, or level within the noise beside the
pulse over more of the pulse's width than those of a rounded pulse are. The missing part is restored by the cubic
polynomial of the logarithm through two points on either side of the plateau, which is exact for a Gaussian and follows
the skew of other pulses. The range of the restored record minus that of the record itself is the estimate of the error,
for any ranging method: a fraction of the peak is crossed too early, and the centroid of a skew pulse, or the delay at
which it matches best, moves.
"""

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from aerokernels.echo.pulse_curve import PLATEAU, PulseCurve
from aerokernels.echo.pulses import SPEED_OF_LIGHT
from aerokernels.echo.shaped_curve import Shape
from aerokernels.inputs.checks import warn_caller

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
# Error above which a warning is issued, relative to the pulse's width: 0.45 mm for a width of 10 ns.
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


# Fractions of the plateau's level below which the points are; above them the plateau's edge distorts the curve.
LEVELS = 0.9, 0.5


class SaturatedRecordWarning(UserWarning):
    """A record's peak is cut off, and the ranging method depends on the peak."""


def cut_samples(volts: np.ndarray, shape: Shape | None = None, period: float = 1.0) -> slice:
    """Return the samples of a record's peak that are cut off; none for a whole peak.

    Args:
        volts: The record, shape (n,).
        shape: The pulse as a function of time [s]; None: not known.
        period: Sample period [s].
    """
    top = int(np.argmax(volts))
    level = float(volts[top])
    if not level > 0.0:
        return slice(0, 0)
    equal, above = _run(volts == level, top), _run(volts >= LEVELS[1] * level, top)
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
        return _length(above) * math.sqrt(depth / -math.log(LEVELS[1]))
    reach = 2 * _length(above)
    own = np.asarray(shape(np.arange(-reach, reach + 1) * period), dtype=np.float64)
    return float(np.count_nonzero(own >= own.max() * (1.0 - max(depth, 1e-12))))


def _noise(volts: np.ndarray, above: slice) -> float:
    """Return the standard deviation beside the pulse, by the median of deviations; 0 if few samples are beside it."""
    place, reach = np.arange(volts.size), 2 * _length(above)
    beside = volts[(place < above.start - reach) | (place >= above.stop + reach)]
    return 1.4826 * float(np.median(np.abs(beside - np.median(beside)))) if beside.size >= 8 else 0.0


def restored(volts: np.ndarray, cut: slice) -> np.ndarray:
    """Return a record with the missing part of its peak, shape (n,); it is nowhere below the record.

    Args:
        volts: The record, shape (n,).
        cut: The samples that are cut off.

    Raises:
        ValueError: The record cuts the pulse on the other sides as well.
    """
    within = np.arange(cut.start, cut.stop)
    level = float(np.median(volts[within]))
    curve = PulseCurve(volts)
    rising = _points(volts[: cut.start][::-1] / level, [curve.rise_before_peak(share * level) for share in LEVELS])
    falling = _points(volts[cut.stop :] / level, [curve.fall_after_peak(share * level) for share in LEVELS])
    place = np.array([at if exact else cut.start - 1.0 - at for at, _, exact in rising])
    place = np.append(place, [at if exact else cut.stop + at for at, _, exact in falling])
    height = np.log([value for _, value, _ in (*rising, *falling)])
    middle, half = 0.5 * (place[0] + place[2]), 0.5 * (place[2] - place[0])
    cubic = np.linalg.solve(np.vander((place - middle) / half, 4), height)
    # The polynomial may rise too far over a wide plateau: by e^3 at most.
    more = np.clip(np.polyval(cubic, (within - middle) / half), 0.0, 3.0)
    whole = volts.copy()
    whole[within] = np.maximum(level * np.exp(more), volts[within])
    return whole


def _points(beside: np.ndarray, crossings: list[float]) -> list[tuple[float, float, bool]]:
    """Return two points beside the plateau: place, value over the plateau's level, and whether it is a crossing.

    They are the samples just below LEVELS, whose places are counted from the plateau on. Where there are no two such
    samples, as on a steep edge, the crossings of these levels by the curve through all samples are taken.
    """
    inner = int(np.argmax(beside < LEVELS[0]))
    outer = max(int(np.argmax(beside < LEVELS[1])), inner + 1)
    if outer < beside.size and 0.02 < beside[outer] < beside[inner] < 1.0:
        return [(float(inner), float(beside[inner]), False), (float(outer), float(beside[outer]), False)]
    return [(place, share, True) for place, share in zip(crossings, LEVELS, strict=True)]


def warn_of_saturation(
    volts: np.ndarray, period: float, method: str, read: Callable[[np.ndarray], float], shape: Shape | None
) -> bool:
    """Warn if a record's peak is cut off and the error of its range exceeds the tolerated one.

    Args:
        volts: The record, shape (n,).
        period: Sample period [s].
        method: Name of the ranging method.
        read: Returns the position of arrival [samples] of such a record.
        shape: The pulse as a function of time [s], if it is known: its own top may be flat.

    Returns:
        Whether a warning was issued.
    """
    cut = cut_samples(volts, shape, period)
    if not _length(cut):
        return False
    try:
        shift = 2.5 * (read(restored(volts, cut)) - read(volts))  # the pulse is not quite the restored one
    except ValueError:  # the record cuts the pulse, which is reported elsewhere
        return False
    half = int(np.count_nonzero(volts > LEVELS[1] * float(volts.max())))
    if not abs(shift) > TOLERATED * half:
        return False
    level, metres = float(np.median(volts[cut])), 0.5 * SPEED_OF_LIGHT * period * abs(shift)
    warn_caller(
        f"the {_length(cut)} samples at the record's peak are equal or level, as if an amplifier or digitiser "
        f"saturated at {level:.4g} V: if the pulse goes on above them, method {method!r} reads up to {metres:.2g} m "
        f"too {'little' if shift > 0.0 else 'much'}; attenuate the signal, raise the digitiser's range, or take "
        "'leading-edge'",
        SaturatedRecordWarning,
    )
    return True
