r"""Means of series with their standard errors, for correlated samples, and a test for drift.

The mean of N samples x_t has the variance S(0) / N, where S is the spectrum of the series. The sums

    c_j = sqrt(2 / N) sum over t of  x_t cos(pi j (t + 1/2) / N),   j = 1 ... J,   J = max(8, 1.5 sqrt(N))

do not contain the mean, are independent of one another and have the variances S(j / 2N) (E. Lazarus, D. J. Lewis, J. H.
Stock, M. W. Watson, J. Bus. Econ. Stat. 36 (2018) 541). With S = S_0 / (1 + (j / j_0)^2), as of samples whose
correlation decays exponentially, the likelihood of the sums weights each corner j_0, from that of a single independent
sample in the whole series to samples that are all independent, equally likely in log j_0 before. The standard error is
the standard deviation of the mean over all corners and S_0 (Student's t for each corner). It is large where the series
is too short to tell; two of it contain the true mean in 95 of 100 series that hold four independent samples or more.

The variance about a mean that comes from the same samples is too small by the variance of that mean: with n independent
samples it is multiplied by n / (n - 1), and the correction counts as an error.

The trend test is Mann and Kendall's, with its variance multiplied by N / n of the series without its linear drift
(K. H. Hamed and A. R. Rao, J. Hydrol. 204 (1998) 182).
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

LEAST_SNAPSHOTS = 4  # samples needed for an error estimate
LEAST_SUMS = 8  # cosines, if there are as many samples
# Corners of the spectrum: the least, of one independent sample, pi j0 / 2 = 1; the greatest over J; steps in log2.
CORNERS, CORNER_STEP = (2.0 / math.pi, 10.0), 0.5
MOST_INDEPENDENT = 10.0  # greatest number of independent samples that a sample counts as, where samples alternate
MANY = 1e6  # degrees of freedom, half of them, of which a variance is normally distributed
COLUMNS = 4096  # series processed together
HELD = 0.95  # share of cases in which two standard errors contain the truth


@dataclass(frozen=True)
class Mean:
    """A mean over time."""

    value: float
    error: float  # its standard error; NaN below four samples
    effective_count: float  # equivalent number of independent samples
    trend: float  # probability that a series without drift shows at least this trend


def standard_errors(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the standard error of the mean of each series, shape (n, ...), and its number of independent samples.

    Both have the shape of one sample; errors are NaN below four samples.
    """
    count, shape = len(values), values.shape[1:]
    if count < LEAST_SNAPSHOTS:
        return np.full(shape, np.nan), np.full(shape, float(count))
    flat = values.reshape(count, -1)
    parts = [_standard_errors(flat[:, k : k + COLUMNS]) for k in range(0, flat.shape[1], COLUMNS)]
    error, independent = (np.concatenate(each).reshape(shape) for each in zip(*parts, strict=True))
    return error, independent


def _standard_errors(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return `standard_errors` of columns, shape (n, m)."""
    count = len(values)
    order = np.arange(1, min(count - 1, max(LEAST_SUMS, round(1.5 * math.sqrt(count)))) + 1)
    cosines = math.sqrt(2.0 / count) * np.cos(np.pi / count * order[:, None] * (np.arange(count) + 0.5))
    flat = values - values.mean(axis=0)
    variance = np.mean(flat**2, axis=0)
    steps = math.ceil(math.log2(CORNERS[1] * len(order) / CORNERS[0]) / CORNER_STEP)
    corner = np.geomspace(CORNERS[0], CORNERS[1] * len(order), steps + 1)
    fall = 1.0 + (order / corner[:, None]) ** 2
    sums = fall @ (cosines @ flat) ** 2  # J times S_0, for each corner
    known = variance > np.square(count * np.finfo(np.float64).eps * np.abs(values).max(axis=0))
    sums = np.where(known & (sums > 0.0), sums, 1.0)
    weight = 0.5 * (np.log(fall).sum(axis=1)[:, None] - len(order) * np.log(sums))
    weight = np.exp(weight - weight.max(axis=0))
    weight /= weight.sum(axis=0)
    error = np.sqrt(np.sum(weight * sums, axis=0) / (max(len(order) - 2, 1) * count))
    independent = 1.0 + np.sum(weight * variance * len(order) * count / sums, axis=0)
    error = np.maximum(error, np.sqrt(variance / (MOST_INDEPENDENT * count)))
    return np.where(known, error, 0.0), np.where(known, np.minimum(independent, MOST_INDEPENDENT * count), float(count))


def mean_of(values: np.ndarray) -> Mean:
    """Return the mean of a series of samples, shape (n,), with its error; samples that are not finite are left out."""
    values = np.asarray(values, dtype=np.float64)
    values = values[np.isfinite(values)]
    if not len(values):
        return Mean(math.nan, math.nan, 0.0, math.nan)
    error, independent = standard_errors(values)
    return Mean(float(values.mean()), float(error), float(independent), trend_of(values))


def about_mean_of(squares: np.ndarray, independent: float) -> Mean:
    """Return the mean of squares about the samples' own mean in time, corrected for it, by its independent samples."""
    found = mean_of(squares)
    value, error = _corrected(found.value, found.error, independent)
    return Mean(float(value), float(error), found.effective_count, found.trend)


def deviations_of(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the standard deviation of each series, shape (n, ...), and its standard error.

    The variance has no more degrees of freedom than there are independent samples.
    """
    _, independent = standard_errors(values)
    squares = (values - values.mean(axis=0)) ** 2
    mean = squares.mean(axis=0)
    error = np.maximum(standard_errors(squares)[0], mean * np.sqrt(2.0 / independent))
    value, error = _corrected(mean, error, independent)
    return np.sqrt(value), root_errors(value, error)


def _corrected(mean_square: Any, error: Any, independent: Any) -> tuple[Any, Any]:
    """Return mean squares about a mean of so many independent samples, and their errors, corrected; NaN for one."""
    more = 1.0 / np.where(np.asarray(independent) > 1.0, np.asarray(independent) - 1.0, np.nan)
    return mean_square * (1.0 + more), np.hypot(error * (1.0 + more), mean_square * more)


def root_of(mean_square: Mean) -> Mean:
    """Return the root of a mean square."""
    root = math.sqrt(max(mean_square.value, 0.0))
    error = float(root_errors(max(mean_square.value, 0.0), mean_square.error))
    return Mean(root, error, mean_square.effective_count, mean_square.trend)


def root_errors(mean_square: Any, error: Any) -> np.ndarray:
    """Return standard errors of the roots of mean squares, which are distributed as chi squared; any shape.

    For a small relative error that is half of it; a mean square of few samples is often far too small.
    """
    square = np.asarray(mean_square, dtype=np.float64)
    share = np.divide(error, square, out=np.zeros_like(square), where=square > 0.0)
    freedom = 2.0 / np.where(share > 0.0, share, 1.0) ** 2
    return np.where(square > 0.0, np.sqrt(square) * np.where(share > 0.0, spread_share(freedom, 0.5), share), error)


def spread_share(freedom: Any, power: float = 1.0) -> np.ndarray:
    """Return half of the share by which a variance, to a power, may be too small in 1 of 20 cases.

    At least the standard error of a normal distribution, power * sqrt(2 / freedom), for the degrees of freedom of chi
    squared; one at least is assumed.
    """
    from scipy.special import gammaincinv

    half = 0.5 * np.maximum(freedom, 1.0)
    few = np.minimum(half, MANY)
    greatest = np.where(half < MANY, (few / gammaincinv(few, 1.0 - HELD)) ** power - 1.0, 0.0)
    return np.asarray(np.maximum(0.5 * greatest, power / np.sqrt(half)))


def student_share(count: int) -> float:
    """Return the factor on a standard error from so many numbers with which two of it hold in 95 of 100 cases."""
    from scipy.special import stdtrit

    return 0.5 * float(stdtrit(count - 1, 0.5 * (1.0 + HELD)))


def trend_of(values: np.ndarray) -> float:
    """Return the probability of a Mann-Kendall statistic at least as great as this one in a series without drift."""
    count = len(values)
    if count < LEAST_SNAPSHOTS or not np.ptp(values) > 0.0:
        return math.nan
    from scipy.stats import kendalltau

    place = np.arange(count)
    statistic = kendalltau(place, values).statistic
    # The correlation of the samples is that of the residual after a linear drift.
    slope, start = np.polyfit(place, values, 1)
    independent = float(standard_errors(values - slope * place - start)[1])
    spread = math.sqrt(2.0 * (2.0 * count + 5.0) / (9.0 * count * (count - 1.0)) * max(count / independent, 1.0))
    return math.erfc(abs(statistic) / spread / math.sqrt(2.0))
