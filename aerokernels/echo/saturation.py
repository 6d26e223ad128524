"""Detect records whose peak an amplifier or a digitiser has cut off, and estimate the error of a fraction of that peak.

A Gaussian pulse of peak P that is cut off at V has, at the level L, the width w(L)^2 = 4 tau^2 ln(P / L), so P follows
from the widths at two levels below V. The pulse crosses a fraction of V earlier than the same fraction of P. If that
fraction of P is above V, its crossing is not in the record: it is before the middle of the plateau.
"""

import math
from collections.abc import Callable

import numpy as np

from ..inputs.warned import warn_caller
from .pulse_curve import PLATEAU, PulseCurve
from .waveform import SPEED_OF_LIGHT

# Fractions of the plateau's level at which the widths are measured; above them the plateau's edge distorts the curve.
LEVELS = 0.9, 0.5
# The pulse is not quite a Gaussian.
SAFETY = 1.5
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


def saturation_shift(volts: np.ndarray, fraction: float) -> float:
    """Return how much too early a constant fraction of a cut-off peak may be [samples]; 0 for a peak that is whole."""
    count = plateau(volts)
    if not count:
        return 0.0
    curve, level = PulseCurve(volts), float(volts.max())
    try:
        rises = [curve.rise_before_peak(share * level) for share in LEVELS]
        squares = [
            (curve.fall_after_peak(share * level) - rise) ** 2 for share, rise in zip(LEVELS, rises, strict=True)
        ]
        read = curve.rise_before_peak(fraction * curve.peak)
        steep = squares[1] - squares[0]
        beyond = math.log(LEVELS[0] / LEVELS[1]) * squares[0] / steep + math.log(LEVELS[0]) if steep > 0.0 else math.inf
        wanted = math.log(fraction) + max(beyond, 0.0)
        if wanted < math.log(LEVELS[0]):
            late = curve.rise_before_peak(math.exp(wanted) * level)
        else:
            late = int(np.argmax(volts)) + 0.5 * (count - 1)
    except ValueError:  # the record cuts the pulse, which is reported elsewhere
        return 0.0
    return SAFETY * abs(late - read)


def warn_of_saturation(volts: np.ndarray, period: float, fraction: float, shape: Callable | None) -> bool:
    """Warn if a record's peak is cut off and the error of a constant fraction exceeds the tolerated one.

    Args:
        volts: The record, shape (n,).
        period: Sample period [s].
        fraction: Fraction of the peak.
        shape: The pulse as a function of time [s], if it is known: its own top may be flat.

    Returns:
        Whether a warning was issued.
    """
    count, shift = plateau(volts), saturation_shift(volts, fraction)
    half = int(np.count_nonzero(volts > LEVELS[1] * float(volts.max())))
    if not shift > TOLERATED * half:
        return False
    if shape is not None:
        own = np.asarray(shape(np.arange(-count, count + 1) * period), dtype=np.float64)
        if np.count_nonzero(own >= own.max() * (1.0 - 1e-12)) >= count - 1:
            return False
    warn_caller(
        f"the {count} greatest samples of the record are equal, as if an amplifier or a digitiser saturated at "
        f"{float(volts.max()):.4g} V: if the pulse goes on above them, method 'constant-fraction' reads up to "
        f"{0.5 * SPEED_OF_LIGHT * period * shift:.2g} m too little; attenuate the signal, raise the digitiser's range, "
        "or take 'leading-edge'",
        SaturatedRecordWarning,
    )
    return True
