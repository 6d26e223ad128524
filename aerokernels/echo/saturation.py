"""Detect records whose peak an amplifier or a digitiser has cut off, and estimate what that changes of a range.

A peak counts as cut off if its samples are equal, if they are level within the noise beside the pulse over more of the
pulse's width than those of a rounded pulse are, or, if the pulse's shape is known, if they do not fit that shape. The
missing part is restored: by the pulse's shape, fitted to the other samples, or, if the shape is not known, by the cubic
polynomial of the logarithm through two points on either side of the plateau, which is exact for a Gaussian and follows
the skew of other pulses. The range of the restored record minus that of the record itself is the estimate, for any
ranging method: a fraction of the peak is crossed too early, and the centroid of a skew pulse, or the delay at which it
matches best, moves.
"""

import math
from collections.abc import Callable

import numpy as np

from aerokernels.inputs.checks import warn_caller

from .pulse_curve import PLATEAU, PulseCurve
from .shaped_curve import Shape, best_match
from .waveform import SPEED_OF_LIGHT

# Fractions of the plateau's level below which the points are; above them the plateau's edge distorts the curve.
LEVELS = 0.9, 0.5
# Least value of a sample that is such a point, relative to the plateau's level: noise governs the logarithm of others.
LEAST = 0.02
# Greatest logarithm of a restored peak over the plateau's level: the polynomial may rise too far over a wide plateau.
GREATEST = 3.0
# The pulse is not quite the restored one.
SAFETY = 2.5
# Shift above which a warning is issued, relative to the width of the pulse: as for too few samples.
TOLERATED = 3e-4
# A plateau: least and greatest depth, relative to the peak, within which its samples lie, and the depth in standard
# deviations of the noise; how many times as wide it is as a rounded pulse is at that depth; and the pulse's width over
# that of the running mean which reduces the noise.
DEPTHS, DEVIATIONS, FLAT, SMOOTHED = (1e-3, 0.25), 6.0, 1.6, 6
# A pulse does not fit its shape if the rms of the rest is above these multiples of the noise and of the peak.
MISFIT, IMPERFECT = 3.0, 0.01


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
    width = max(1, _length(above) // SMOOTHED)
    smooth = np.convolve(volts, np.full(width, 1.0 / width), "same")
    top = above.start + int(np.argmax(smooth[above]))
    depth = max(DEPTHS[0] * level, DEVIATIONS * _noise(smooth, above))
    flat = _run(smooth >= smooth[top] - depth, top)
    wide = FLAT * _rounded(depth / level, above, shape, period) + 2.0
    if depth < DEPTHS[1] * level and _length(flat) > max(wide, PLATEAU):
        return flat if shape is None else above
    if shape is None or _length(above) < PLATEAU:
        return slice(0, 0)
    try:
        delay, height = best_match(volts, shape, period)
    except ValueError:  # no pulse of that shape
        return slice(0, 0)
    place = np.arange(above.start, above.stop)
    rest = volts[above] - height * np.asarray(shape((place - delay) * period))
    fits = float(np.sqrt(np.mean(rest**2))) <= max(MISFIT * _noise(volts, above), IMPERFECT * level)
    return slice(0, 0) if fits else above


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


def restored(volts: np.ndarray, shape: Shape | None = None, period: float = 1.0) -> np.ndarray:
    """Return a record with the missing part of its peak, shape (n,); it is nowhere below the record.

    Args:
        volts: The record, shape (n,), whose peak is cut off.
        shape: The pulse as a function of time [s]; None: not known.
        period: Sample period [s].

    Raises:
        ValueError: The record cuts the pulse on the other sides as well.
    """
    cut = cut_samples(volts, shape, period)
    found, within = volts.copy(), np.arange(cut.start, cut.stop)
    if shape is not None:
        found[within] = np.maximum(_fitted(volts, within, shape, period), volts[within])
        return found
    level = float(np.median(volts[within]))
    curve = PulseCurve(volts)
    rising = _points(volts[: cut.start][::-1] / level, [curve.rise_before_peak(share * level) for share in LEVELS])
    falling = _points(volts[cut.stop :] / level, [curve.fall_after_peak(share * level) for share in LEVELS])
    place = np.array([at if exact else cut.start - 1.0 - at for at, _, exact in rising])
    place = np.append(place, [at if exact else cut.stop + at for at, _, exact in falling])
    height = np.log([value for _, value, _ in (*rising, *falling)])
    middle, half = 0.5 * (place[0] + place[2]), 0.5 * (place[2] - place[0])
    cubic = np.linalg.solve(np.vander((place - middle) / half, 4), height)
    more = np.clip(np.polyval(cubic, (within - middle) / half), 0.0, GREATEST)
    found[within] = np.maximum(level * np.exp(more), volts[within])
    return found


def _fitted(volts: np.ndarray, within: np.ndarray, shape: Shape, period: float) -> np.ndarray:
    """Return the samples `within` of the pulse of a shape that fits all other samples best, shape (m,).

    Raises:
        ValueError: The record correlates with no such pulse.
    """
    from scipy.optimize import minimize_scalar

    place = np.arange(volts.size)
    known = np.ones(volts.size, dtype=bool)
    known[within] = False

    def pulse(delay: float) -> tuple[np.ndarray, float]:
        samples = np.asarray(shape((place - delay) * period))
        return samples, float(samples[known] @ volts[known]) / (float(np.sum(samples[known] ** 2)) or 1.0)

    def rest(delay: float) -> float:
        samples, factor = pulse(delay)
        return float(np.sum((volts[known] - factor * samples[known]) ** 2))

    start, _ = best_match(volts, shape, period)
    bounds = start - 0.5 * within.size, start + 0.5 * within.size
    delay = float(minimize_scalar(rest, bounds=bounds, method="bounded", options={"xatol": 1e-6}).x)
    samples, factor = pulse(delay)
    return factor * samples[within]


def _points(beside: np.ndarray, crossings: list[float]) -> list[tuple[float, float, bool]]:
    """Return two points beside the plateau: place, value over the plateau's level, and whether it is a crossing.

    They are the samples just below LEVELS, whose places are counted from the plateau on. Where there are no two such
    samples, as on a steep edge, the crossings of these levels by the curve through all samples are taken.
    """
    inner = int(np.argmax(beside < LEVELS[0]))
    outer = max(int(np.argmax(beside < LEVELS[1])), inner + 1)
    if outer < beside.size and LEAST < beside[outer] < beside[inner] < 1.0:
        return [(float(inner), float(beside[inner]), False), (float(outer), float(beside[outer]), False)]
    return [(place, share, True) for place, share in zip(crossings, LEVELS, strict=True)]


def saturation_shift(
    volts: np.ndarray, read: Callable[[np.ndarray], float], shape: Shape | None = None, period: float = 1.0
) -> float:
    """Return how much later the pulse may be than a record reads whose peak is cut off [samples]; 0 for a whole peak.

    Args:
        volts: The record, shape (n,).
        read: Returns the position of arrival [samples] of such a record.
        shape: As for `restored`.
        period: As for `restored` [s].
    """
    if not _length(cut_samples(volts, shape, period)):
        return 0.0
    try:
        return SAFETY * (read(restored(volts, shape, period)) - read(volts))
    except ValueError:  # the record cuts the pulse, which is reported elsewhere
        return 0.0


def warn_of_saturation(
    volts: np.ndarray, period: float, method: str, read: Callable[[np.ndarray], float], shape: Shape | None
) -> bool:
    """Warn if a record's peak is cut off and the error of its range exceeds the tolerated one.

    Args:
        volts: The record, shape (n,).
        period: Sample period [s].
        method: Name of the ranging method.
        read: As for `saturation_shift`.
        shape: The pulse as a function of time [s], if it is known: its own top may be flat.

    Returns:
        Whether a warning was issued.
    """
    cut = cut_samples(volts, shape, period)
    if not _length(cut):
        return False
    shift = saturation_shift(volts, read, shape, period)
    half = int(np.count_nonzero(volts > LEVELS[1] * float(volts.max())))
    if not abs(shift) > TOLERATED * half:
        return False
    level, metres = float(np.median(volts[cut])), 0.5 * SPEED_OF_LIGHT * period * abs(shift)
    warn_caller(
        f"the {_length(cut)} samples at the record's peak are equal or level, or lower than the pulse that fits the "
        f"others, as if an amplifier or digitiser saturated at {level:.4g} V: if the pulse goes on above them, method "
        f"{method!r} reads up to {metres:.2g} m too {'little' if shift > 0.0 else 'much'}; attenuate the signal, raise "
        "the digitiser's range, or take 'leading-edge'",
        SaturatedRecordWarning,
    )
    return True
