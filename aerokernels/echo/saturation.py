"""Records whose peak an amplifier or a digitiser has cut off, and what that does to a fraction of the peak.

A Gaussian pulse of peak P that is cut off at V has at the level L the width w(L)^2 = 4 tau^2 ln(P / L), so that its
widths at two levels below V tell P. A constant fraction of V is crossed earlier than one of P. Where that fraction of P
lies above V, nobody sees its crossing: it lies before the middle of the plateau.
"""

import math
import warnings
from collections.abc import Callable

import numpy as np

from .pulse_curve import PLATEAU, PulseCurve
from .waveform import SPEED_OF_LIGHT

# Levels of the plateau whose widths tell the peak; above the higher one the curve feels the plateau's edge.
LEVELS = 0.9, 0.5
# The pulse is not quite a Gaussian.
SAFETY = 1.5
# Shift above which a reading is warned of, over the width of the pulse: as for too few samples.
TOLERATED = 3e-4


class SaturatedRecordWarning(UserWarning):
    """A record's peak is cut off, and the ranging method goes by it."""


def plateau(volts: np.ndarray) -> int:
    """How many samples on end have a record's greatest value, 0 where they are too few to be a cut."""
    top = int(np.argmax(volts))
    after = np.flatnonzero(volts[top:] != volts[top])
    count = int(after[0]) if after.size else volts.size - top
    return count if count >= PLATEAU else 0


def saturation_shift(volts: np.ndarray, fraction: float) -> float:
    """How much too early a constant fraction of a cut-off peak may be [samples]; 0 where none is cut off."""
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
    except ValueError:  # the record cuts the pulse: other words tell of it
        return 0.0
    return SAFETY * abs(late - read)


def warn_of_saturation(volts: np.ndarray, period: float, fraction: float, shape: Callable | None) -> bool:
    """Warn where the peak of a record is cut off and a constant fraction of it is off by more than is tolerated.

    Args:
        volts: The record, shape (n,).
        period: Sample period [s].
        fraction: Share of the peak.
        shape: The pulse as a function of time [s], where it is known: its own top may be flat.

    Returns:
        Whether it did.
    """
    count, shift = plateau(volts), saturation_shift(volts, fraction)
    half = int(np.count_nonzero(volts > LEVELS[1] * float(volts.max())))
    if not shift > TOLERATED * half:
        return False
    if shape is not None:
        own = np.asarray(shape(np.arange(-count, count + 1) * period), dtype=np.float64)
        if np.count_nonzero(own >= own.max() * (1.0 - 1e-12)) >= count - 1:
            return False
    warnings.warn(
        f"the {count} greatest samples of the record are alike, as where an amplifier or a digitiser saturates at "
        f"{float(volts.max()):.4g} V: if the pulse goes on above them, method 'constant-fraction' reads up to "
        f"{0.5 * SPEED_OF_LIGHT * period * shift:.2g} m too little; attenuate the signal, raise the digitiser's range, "
        "or take 'leading-edge'",
        SaturatedRecordWarning,
        stacklevel=5,  # who called the public function, which is looked at by `checked`
    )
    return True
