"""Modes, two-point correlations and spectra of unsteady wavefronts; means in time with standard errors."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class Modes:
    """Proper orthogonal modes of maps about their mean."""

    shape: np.ndarray  # modes of weighted mean square 1, shape (m, n); NaN for those without energy
    energy: np.ndarray  # mean square of each coefficient [m2], descending, shape (m,)
    coefficient: np.ndarray  # of each map [m], shape (t, m)
    total: float  # mean square of all modes together [m2]


def about_mean(maps: np.ndarray) -> np.ndarray:
    """Return maps minus their mean in time, shape (t, n): exactly 0 where a pixel is constant, apart from rounding."""
    left = maps - maps.mean(axis=0)
    rounding = len(maps) * np.finfo(np.float64).eps * np.abs(maps).max(axis=0)
    left[:, np.abs(left).max(axis=0) <= rounding] = 0.0
    return np.asarray(left)


def orthogonal_modes(maps: np.ndarray, weight: np.ndarray, count: int) -> Modes:
    """Return the first modes of maps about their mean, shape (t, n), with pixels of weights that sum to 1, shape (n,).

    The smaller of the two eigenvalue problems is solved: over times, or over pixels.
    """
    from scipy.linalg import eigh

    flat = about_mean(maps) * np.sqrt(weight)
    times, pixels = flat.shape
    total = float((flat**2).sum() / times)
    count = min(count, max(times - 1, 1), pixels)
    small = flat @ flat.T if times <= pixels else flat.T @ flat
    size = len(small)
    values, vectors = eigh(small, subset_by_index=[size - count, size - 1])
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    # Eigenvalues below the rounding of the greatest one are noise of the solver, and so are their shapes.
    values[values <= size * np.finfo(np.float64).eps * values[0]] = 0.0
    root = np.sqrt(values)
    if times <= pixels:
        coefficient = vectors * root
        rows = (flat.T @ vectors / np.where(root > 0.0, root, 1.0)).T
    else:
        rows = vectors.T
        coefficient = flat @ vectors
    coefficient[:, values == 0.0] = 0.0
    shape = np.where(values[:, None] > 0.0, rows / np.sqrt(weight), np.nan)
    # The sign of a mode is arbitrary: make its greatest entry positive.
    sign = np.sign(shape[np.arange(count), np.abs(shape).argmax(axis=1)])
    sign[~(np.abs(sign) > 0.0)] = 1.0
    return Modes(shape * sign[:, None], values / times, coefficient * sign, total)


def two_point_correlation(maps: np.ndarray, lit: np.ndarray, mean: Any = None) -> np.ndarray:
    """Return the mean product of maps of lit pixels, shape (t, n), about their mean, or `mean`, at two pixels.

    Averaged over maps and pairs of one distance, shape (2 ny - 1, 2 nx - 1), distance zero in the middle; NaN where no
    two pixels have that distance.
    """
    ny, nx = lit.shape
    size = (2 * ny, 2 * nx)
    flat = about_mean(maps) if mean is None else maps - mean
    power = np.zeros((size[0], size[1] // 2 + 1))
    square = np.zeros(lit.shape)
    for one in flat:
        square[lit] = one
        power += np.abs(np.fft.rfft2(square, size)) ** 2
    pairs = np.fft.irfft2(np.abs(np.fft.rfft2(lit.astype(float), size)) ** 2, size)
    products = np.fft.irfft2(power / len(flat), size)
    with np.errstate(invalid="ignore", divide="ignore"):
        result = np.where(pairs > 0.5, products / np.round(pairs), np.nan)
    shifted = np.fft.fftshift(result)
    return np.asarray(shifted[1:, 1:])


def integral_length(correlation: np.ndarray, pixel: float) -> float:
    """Return the integral of a correlation, of any scale, from distance zero to its first zero [m]."""
    if not correlation[0] > 0.0:
        return float("nan")
    good = np.isfinite(correlation)
    count = len(correlation) if good.all() else int(np.argmin(good))
    below = correlation[:count] <= 0.0
    stop = int(np.argmax(below)) if below.any() else count
    area = float(np.trapezoid(correlation[:stop]))
    if below.any():  # a triangle up to where the line between two entries meets zero
        area += float(0.5 * correlation[stop - 1] ** 2 / (correlation[stop - 1] - correlation[stop]))
    return pixel * area / float(correlation[0])


LEAST_SEGMENT = 8
SPECTRA_AT_ONCE = 256  # processed together


@dataclass(frozen=True, eq=False)
class Spectrum:
    """A power spectral density."""

    frequency: np.ndarray  # [Hz], shape (f,)
    density: np.ndarray  # [square of the unit / Hz], shape (f, ...)
    error: np.ndarray  # its standard error, of the same shape
    segment_count: float  # independent segments averaged


def sample_rate(time: np.ndarray) -> float:
    """Return the samples per second of even times [s]; raises a ValueError for uneven ones, or too few."""
    if len(time) < 2 * LEAST_SEGMENT:
        raise ValueError(f"spectra need at least {2 * LEAST_SEGMENT} snapshots, there are {len(time)}")
    steps = np.diff(time)
    if np.abs(steps - steps.mean()).max() > 1e-3 * steps.mean():
        raise ValueError("spectra need even times: interpolate the series in time first")
    return float(1.0 / steps.mean())


def welch(values: np.ndarray, rate: float, segment: int | None = None) -> Spectrum:
    """Return the spectrum of samples along the first axis, with their mean subtracted.

    A segment has `segment` samples, by default so many that there are about eight segments; raises a ValueError for one
    that is longer than the series, or below eight samples.
    """
    from scipy import signal

    count = len(values)
    length = max(LEAST_SEGMENT, 2 * count // 9) if segment is None else int(segment)
    if not LEAST_SEGMENT <= length <= count:
        raise ValueError(f"a segment of {length} samples: give {LEAST_SEGMENT} to {count}")
    flat = values - values.mean(axis=0)
    frequency, density = signal.welch(flat, rate, "hann", length, length // 2, detrend=False, axis=0)
    # Half-overlapping Hann segments: (36 K^2) / (19 K - 1) / 2 independent pairs of a sine and a cosine, or single
    # ones at zero and at half the rate.
    segments = max(1, (count - length // 2) // (length - length // 2))
    independent = max(1.0, 18.0 * segments**2 / (19.0 * segments - 1.0)) if segments > 1 else 1.0
    freedom = np.full(len(frequency), 2.0 * independent)
    freedom[[0, *([-1] if length % 2 == 0 else [])]] = independent
    noise = density * spread_share(freedom).reshape(-1, *(1,) * (values.ndim - 1))
    # Segments of half the length are a second rule, which tells what a finite length smooths.
    half = length // 2
    rough, other = signal.welch(flat, rate, "hann", half, half // 2, detrend=False, axis=0)
    change = np.apply_along_axis(lambda one: np.interp(frequency, rough, one), 0, other) - density
    return Spectrum(frequency, density, np.hypot(noise, change), independent)


def mean_spectrum(values: np.ndarray, weight: np.ndarray, rate: float, segment: int | None = None) -> Spectrum:
    """Return the weighted mean of the spectra of columns, shape (n, m), with weights of shape (m,).

    Some columns are processed at a time: segments, windows and transforms of all take several times their memory.
    """
    parts = [
        (welch(values[:, k : k + SPECTRA_AT_ONCE], rate, segment), weight[k : k + SPECTRA_AT_ONCE])
        for k in range(0, values.shape[1], SPECTRA_AT_ONCE)
    ]
    density, error = (np.sum([getattr(one, name) @ own for one, own in parts], axis=0) for name in ("density", "error"))
    first = parts[0][0]
    return Spectrum(first.frequency, density, error, first.segment_count)


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
    r"""Return `standard_errors` of columns, shape (n, m).

    The mean of N samples x_t has the variance S(0) / N, where S is the spectrum of the series. The sums

        c_j = sqrt(2 / N) sum over t of  x_t cos(pi j (t + 1/2) / N),   j = 1 ... J,   J = max(8, 1.5 sqrt(N))

    do not contain the mean, are independent and have the variances S(j / 2N) (E. Lazarus, D. J. Lewis, J. H. Stock,
    M. W. Watson, J. Bus. Econ. Stat. 36 (2018) 541). With S = S_0 / (1 + (j / j_0)^2), as of samples whose correlation
    decays exponentially, their likelihood weights each corner j_0, equally likely in log j_0 before. The error is the
    standard deviation of the mean over all corners and S_0, large where the series is too short to tell.
    """
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
        return Mean(math.nan, math.nan, 0.0)
    error, independent = standard_errors(values)
    return Mean(float(values.mean()), float(error), float(independent))


def about_mean_of(squares: np.ndarray, independent: float) -> Mean:
    """Return the mean of squares about the samples' own mean in time, corrected for it, by its independent samples."""
    result = mean_of(squares)
    value, error = _corrected(result.value, result.error, independent)
    return Mean(float(value), float(error), result.effective_count)


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
    """Return mean squares about a mean of n independent samples times n / (n - 1), and their errors; NaN for one."""
    more = 1.0 / np.where(np.asarray(independent) > 1.0, np.asarray(independent) - 1.0, np.nan)
    return mean_square * (1.0 + more), np.hypot(error * (1.0 + more), mean_square * more)


def root_of(mean_square: Mean) -> Mean:
    """Return the root of a mean square."""
    root = math.sqrt(max(mean_square.value, 0.0))
    error = float(root_errors(max(mean_square.value, 0.0), mean_square.error))
    return Mean(root, error, mean_square.effective_count)


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
