"""Bound the error of a Strehl ratio by the error of the phase."""

import numpy as np


def strehl_error(ratio: float, phase_error: float) -> float:
    """Bound the error of a Strehl ratio whose phase has an error of `phase_error` [rad], rms over the pupil.

    |<exp(i p)>|^2 changes by -2 Im(A* <q exp(i p)>) + ... for a change q of the phase, A = <exp(i p)>. The mean part A
    of
    exp(i p) contributes nothing, because A* A <q> is real; so the change is at most 2 rms(q) sqrt(S (1 - S)) by
    Schwarz's
    inequality. The terms of second order are at most rms(q)^2.
    """
    spread = np.sqrt(max(ratio * (1.0 - ratio), 0.0))
    return float(min(2.0 * phase_error * spread + phase_error**2, 1.0)) if np.isfinite(phase_error) else float("nan")
