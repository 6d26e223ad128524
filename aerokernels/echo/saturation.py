"""Detect records whose peak an amplifier or a digitiser has cut off, and estimate what that changes of a range.

The missing part is restored: by the pulse's shape, fitted to the other samples, or, if the shape is not known, by the
cubic polynomial of the logarithm through two points on either side of the plateau, which is exact for a Gaussian and
follows the skew of other pulses. The range of the restored record minus that of the record itself is the estimate, for
any ranging method: a fraction of the peak is crossed too early, and the centroid of a skew pulse, or the delay at which
it matches best, moves.
"""

from collections.abc import Callable

import numpy as np

from ..inputs.warned import warn_caller
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


class SaturatedRecordWarning(UserWarning):
    """A record's peak is cut off, and the ranging method depends on the peak."""


def plateau(volts: np.ndarray) -> int:
    """Return the number of consecutive samples at a record's greatest value; 0 if they are too few to be a cut."""
    top = int(np.argmax(volts))
    after = np.flatnonzero(volts[top:] != volts[top])
    count = int(after[0]) if after.size else volts.size - top
    return count if count >= PLATEAU else 0


def restored(volts: np.ndarray, shape: Shape | None = None, period: float = 1.0) -> np.ndarray:
    """Return a record with the missing part of its peak, shape (n,); it is nowhere below the record.

    Args:
        volts: The record, shape (n,).
        shape: The pulse as a function of time [s]; None: not known.
        period: Sample period [s].

    Raises:
        ValueError: The record cuts the pulse on the other sides as well.
    """
    count, first, level = plateau(volts), int(np.argmax(volts)), float(volts.max())
    curve = PulseCurve(volts)
    rising = _points(volts[:first][::-1] / level, [curve.rise_before_peak(share * level) for share in LEVELS])
    falling = _points(volts[first + count :] / level, [curve.fall_after_peak(share * level) for share in LEVELS])
    place = np.array([at if exact else first - 1.0 - at for at, _, exact in rising])
    place = np.append(place, [at if exact else first + count + at for at, _, exact in falling])
    height = np.log([value for _, value, _ in (*rising, *falling)])
    middle, half = 0.5 * (place[0] + place[2]), 0.5 * (place[2] - place[0])
    cubic = np.linalg.solve(np.vander((place - middle) / half, 4), height)
    within = np.arange(first, first + count)
    more = np.clip(np.polyval(cubic, (within - middle) / half), 0.0, GREATEST)
    found = volts.copy()
    found[within] = level * np.exp(more)
    if shape is not None:
        found[within] = np.maximum(_fitted(found, within, shape, period), level)
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
    if not plateau(volts):
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
    count = plateau(volts)
    if not count:
        return False
    if shape is not None:
        own = np.asarray(shape(np.arange(-count, count + 1) * period), dtype=np.float64)
        if np.count_nonzero(own >= own.max() * (1.0 - 1e-12)) >= count - 1:
            return False
    shift = saturation_shift(volts, read, shape, period)
    half = int(np.count_nonzero(volts > LEVELS[1] * float(volts.max())))
    if not abs(shift) > TOLERATED * half:
        return False
    warn_caller(
        f"the {count} greatest samples of the record are equal, as if an amplifier or a digitiser saturated at "
        f"{float(volts.max()):.4g} V: if the pulse goes on above them, method {method!r} reads up to "
        f"{0.5 * SPEED_OF_LIGHT * period * abs(shift):.2g} m too {'little' if shift > 0.0 else 'much'}; attenuate the "
        "signal, raise the digitiser's range, or take 'leading-edge'",
        SaturatedRecordWarning,
    )
    return True
