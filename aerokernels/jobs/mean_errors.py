"""Errors of numbers that are read from the mean of recorded echoes, and of means and spreads of a few numbers.

All errors are standard errors: they hold the exact value in 68 % of cases. "+-" covers the truth in at least 95 of 100
cases: what is printed after it is `covering` times a standard error. For n echoes the standard error of a mean is
multiplied by Student's t of n - 1 degrees of freedom (1.84 for two echoes, 1.03 for twenty). A spread s holds the exact
one within s (1 +- k), with k from the distribution of chi squared (2.05 / sqrt(2 n - 2) for two echoes, 1 / sqrt(2 n -
2) for many).

What noise leaves of a digitiser's rounding is added to the errors of samples: averages.py.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from aerokernels.jobs.averages import AverageEcho

COVERAGE = 0.6827  # probability of one standard deviation of a normal distribution
TOLD = 0.95  # least share of the cases in which value and error contain the truth
# Draws for the mean excess of a greatest sample, and errors below the peak within which a sample may be the greatest.
DRAWS, NEAR = 200, 6.0


def mean_factor(count: int, coverage: float = COVERAGE) -> float:
    """Return the factor by which the standard error of a mean of `count` numbers is multiplied; NaN below two."""
    from scipy.special import stdtrit

    return float(stdtrit(count - 1, 0.5 * (1.0 + coverage))) if count > 1 else math.nan


def covering(count: int) -> float:
    """Return what the error of a mean of `count` numbers is multiplied by to cover 95 of 100 cases; NaN below two."""
    return mean_factor(count, TOLD) / mean_factor(count)


def spread_factor(count: int, coverage: float = COVERAGE) -> float:
    """Return the error of a standard deviation of `count` numbers as a share of it; NaN below two."""
    from scipy.optimize import brentq
    from scipy.special import gammainc

    if count < 2:
        return math.nan
    half = 0.5 * (count - 1)

    def missing(share: float) -> float:
        upper = gammainc(half, half / (1.0 - share) ** 2) if share < 1.0 else 1.0
        return float(upper - gammainc(half, half / (1.0 + share) ** 2)) - coverage

    return float(brentq(missing, 1e-9, 1e3))


@dataclass(frozen=True, eq=False)
class MeanErrors:
    """Errors of what is read from a mean echo; NaN for a single echo.

    Attributes:
        peak: error of its greatest sample [V], with the mean excess of the greatest of several samples with noise.
        edge_shift: error of the time at which it crosses a level [s]; NaN where the pulse does not.
        lag: error of the lag at which it correlates best with the simulation [s].
    """

    peak: float
    edge_shift: float
    lag: float

    def shifted(self, offset_error: float) -> "MeanErrors":
        """Return the errors with that of a trigger offset [s], which was subtracted from the times."""
        edge_shift, lag = (math.hypot(error, offset_error) for error in (self.edge_shift, self.lag))
        return replace(self, edge_shift=edge_shift, lag=lag)


def mean_errors(
    recorded: AverageEcho, there: np.ndarray, time: np.ndarray, simulated: np.ndarray, level: float
) -> MeanErrors:
    """Compute the errors of a mean echo.

    Args:
        recorded: the mean and its spread.
        there: which of its samples are compared.
        time: their times [s], shape (n,).
        simulated: the simulation at these times [V], shape (n,); not constant.
        level: level of the leading edge [V].
    """
    mean, spread = recorded.mean[there], recorded.spread[there]
    known = np.isfinite(spread)
    error = np.hypot(mean_factor(recorded.count) * recorded.standard_error[there], recorded.rounding)
    top = int(np.argmax(mean))
    slope = np.abs(np.gradient(mean[top] / simulated.max() * simulated, time))
    crossed = np.flatnonzero((mean[1:] >= level) & (mean[:-1] < level))
    edge = math.nan
    if crossed.size:
        at = int(crossed[0]) + int(mean[crossed[0] + 1] - level < level - mean[crossed[0]])
        edge = float(error[at] / slope[at]) if slope[at] > 0.0 else math.nan
    # All samples take part in the lag, so that the few echoes of each need no factor.
    each = np.hypot(recorded.standard_error[there], recorded.rounding)
    return MeanErrors(
        peak=math.hypot(float(error[top]), _excess(simulated * (mean[top] / simulated.max()), error)),
        edge_shift=edge,
        lag=float(np.linalg.norm((slope * each)[known]) / np.sum(slope[known] ** 2)) if known.any() else math.nan,
    )


def _excess(volts: np.ndarray, error: np.ndarray) -> float:
    """Return by how much errors of the samples lift the greatest one on average [V]; NaN where an error is."""
    near = volts > volts.max() - NEAR * error[int(np.argmax(volts))]
    if not near.any():
        return 0.0 if np.isfinite(error[int(np.argmax(volts))]) else math.nan
    volts, error = volts[near], np.nan_to_num(error[near])
    noise = np.random.default_rng(0).standard_normal((DRAWS, volts.size))
    return float((volts + error * noise).max(axis=1).mean()) - float(volts.max())
