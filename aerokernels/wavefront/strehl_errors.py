r"""Greatest change of a Strehl ratio by a phase error of a given rms, however it is correlated with the phase.

A phase error d of mean 0 and rms e changes A = <exp(i p)> by a vector of length at most b, and S = |A|^2 by at most

    E = 2 sqrt(S) b + b^2,    b = min(e, sqrt(1 - S) e + sqrt(S) e^2 / 2)

The first bound is that of |exp(i d) - 1| <= |d|. For the second, turn p so that A is real, and write exp(i p) = A + w
with <w> = 0 and <|w|^2> = 1 - S: by Cauchy and Schwarz |<w (exp(i d) - 1)>| <= sqrt(1 - S) e, and |<exp(i d) - 1>| =
|<exp(i d) - 1 - i d>| <= e^2 / 2.
"""

import numpy as np

# Number of Strehl ratios searched for the one that a phase error changes most.
RATIOS = 201


def strehl_error(value: float, phase: float) -> float:
    """Return the greatest change of a Strehl ratio `value` by a phase error of rms `phase` [rad]."""
    return float(strehl_errors(np.asarray(value), phase))


def strehl_errors(values: np.ndarray, phase: float) -> np.ndarray:
    """Return `strehl_error` of an array of ratios, of the same shape."""
    clipped = np.clip(values, 0.0, 1.0)
    root, rest = np.sqrt(clipped), np.sqrt(1.0 - clipped)
    change = np.minimum(phase, rest * phase + 0.5 * root * phase**2)
    return np.asarray(2.0 * root * change + change**2)


def greatest_strehl_error(phase: float) -> float:
    """Return the greatest change of any Strehl ratio by a phase error of rms `phase` [rad]."""
    return float(strehl_errors(np.linspace(0.0, 1.0, RATIOS), phase).max())
