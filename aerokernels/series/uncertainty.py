r"""Means of series with their standard errors, for correlated samples, and a test for drift.

    N_eff = N / tau,   tau = 1 + 2 sum over the lags of  rho_k,   standard error = s / sqrt(N_eff)

rho_k is the autocorrelation of the series; the sum ends where a pair of neighbours rho_2m + rho_2m+1 is no longer
positive (C. J. Geyer, Stat. Sci. 7 (1992) 473). The trend test is Mann and Kendall's, with its variance multiplied by
tau of the series without its linear drift (K. H. Hamed and A. R. Rao, J. Hydrol. 204 (1998) 182).
"""

import math
from dataclasses import dataclass

import numpy as np

LEAST = 4  # samples needed for an error estimate


@dataclass(frozen=True)
class Mean:
    """A mean over time.

    Attributes:
        value: The mean.
        error: Its standard error; NaN below four samples.
        effective_count: Equivalent number of independent samples.
        trend: Probability that a series without drift shows at least this trend; a small value means that it drifts.
    """

    value: float
    error: float
    effective_count: float
    trend: float


def correlation_sum(values: np.ndarray) -> float:
    """Return tau of a series of samples, shape (n,): 1 for independent samples, at least 1/n."""
    flat = values - values.mean()
    count = len(flat)
    power = float(flat @ flat)
    if count < LEAST or power <= 0.0:
        return 1.0
    size = 1 << (2 * count - 1).bit_length()
    found = np.fft.irfft(np.abs(np.fft.rfft(flat, size)) ** 2, size)[:count]
    rho = found / found[0]
    pairs = rho[: 2 * (count // 2)].reshape(-1, 2).sum(axis=1)
    stop = int(np.argmax(pairs <= 0.0)) if (pairs <= 0.0).any() else len(pairs)
    return float(np.clip(2.0 * pairs[:stop].sum() - 1.0, 1.0 / count, count))


def mean_of(values: np.ndarray) -> Mean:
    """Return the mean of a series of samples, shape (n,), with its error; samples that are not finite are left out."""
    values = np.asarray(values, dtype=np.float64)
    values = values[np.isfinite(values)]
    count = len(values)
    if count == 0:
        return Mean(math.nan, math.nan, 0.0, math.nan)
    if count < LEAST:
        return Mean(float(values.mean()), math.nan, float(count), math.nan)
    tau = correlation_sum(values)
    # Anticorrelated samples make tau small: use at least 0.1.
    error = float(values.std(ddof=1) * math.sqrt(max(tau, 0.1) / count))
    return Mean(float(values.mean()), error, count / max(tau, 0.1), trend_of(values))


def root_of(mean_square: Mean) -> Mean:
    """Return the root of a mean square: its relative error is half that of the mean square."""
    root = math.sqrt(max(mean_square.value, 0.0))
    error = mean_square.error / (2.0 * root) if root > 0.0 else mean_square.error
    return Mean(root, error, mean_square.effective_count, mean_square.trend)


def trend_of(values: np.ndarray) -> float:
    """Return the probability of a Mann-Kendall statistic at least as great as this one in a series without drift."""
    count = len(values)
    if count < LEAST or not np.ptp(values) > 0.0:
        return math.nan
    from scipy.stats import kendalltau

    place = np.arange(count)
    statistic = kendalltau(place, values).statistic
    # The correlation of the samples is that of the residual after a linear drift.
    slope, start = np.polyfit(place, values, 1)
    tau = correlation_sum(values - slope * place - start)
    spread = math.sqrt(2.0 * (2.0 * count + 5.0) / (9.0 * count * (count - 1.0)) * max(tau, 1.0))
    return math.erfc(abs(statistic) / spread / math.sqrt(2.0))
