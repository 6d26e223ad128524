r"""Means of series with their standard errors, when the samples depend on one another, and whether they drift.

    N_eff = N / tau,   tau = 1 + 2 sum over the lags of  rho_k,   standard error = s / sqrt(N_eff)

rho_k is the autocorrelation of the series; the sum ends where a pair of neighbours rho_2m + rho_2m+1 is no longer
positive (C. J. Geyer, Stat. Sci. 7 (1992) 473). The trend test is Mann and Kendall's, its variance multiplied by tau
(K. H. Hamed and A. R. Rao, J. Hydrol. 204 (1998) 182), that of the series without its straight drift.
"""

import math
from dataclasses import dataclass

import numpy as np

LEAST = 4  # samples, for anything to be said of an error


@dataclass(frozen=True)
class Mean:
    """A mean over time.

    Attributes:
        value: The mean.
        error: Its standard error; NaN below four samples.
        effective_count: Independent samples that say as much.
        trend: Probability that a series without drift looks as much like one; small means that it drifts.
    """

    value: float
    error: float
    effective_count: float
    trend: float


def correlation_sum(values: np.ndarray) -> float:
    """Tau of a series of samples, shape (n,): 1 where they are independent, at least 1/n."""
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
    """The mean of a series of samples, shape (n,), with its error; samples that are not finite are left out."""
    values = np.asarray(values, dtype=np.float64)
    values = values[np.isfinite(values)]
    count = len(values)
    if count == 0:
        return Mean(math.nan, math.nan, 0.0, math.nan)
    if count < LEAST:
        return Mean(float(values.mean()), math.nan, float(count), math.nan)
    tau = correlation_sum(values)
    # A pair of opposite samples makes tau small: no error is smaller than that of a tenth of it.
    error = float(values.std(ddof=1) * math.sqrt(max(tau, 0.1) / count))
    return Mean(float(values.mean()), error, count / max(tau, 0.1), trend_of(values))


def root_of(mean_square: Mean) -> Mean:
    """The root of a mean square: its error is half the relative one."""
    root = math.sqrt(max(mean_square.value, 0.0))
    error = mean_square.error / (2.0 * root) if root > 0.0 else mean_square.error
    return Mean(root, error, mean_square.effective_count, mean_square.trend)


def trend_of(values: np.ndarray) -> float:
    """Probability of a Mann-Kendall statistic as great as this one's without drift."""
    count = len(values)
    if count < LEAST or not np.ptp(values) > 0.0:
        return math.nan
    from scipy.stats import kendalltau

    place = np.arange(count)
    statistic = kendalltau(place, values).statistic
    # The samples' dependence on one another is that of what a straight drift leaves.
    slope, start = np.polyfit(place, values, 1)
    tau = correlation_sum(values - slope * place - start)
    spread = math.sqrt(2.0 * (2.0 * count + 5.0) / (9.0 * count * (count - 1.0)) * max(tau, 1.0))
    return math.erfc(abs(statistic) / spread / math.sqrt(2.0))
