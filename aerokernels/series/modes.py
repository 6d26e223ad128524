"""Spatial structure of unsteady wavefronts: proper orthogonal decomposition, and two-point correlation."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from aerokernels.series.uncertainty import spread_share


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
        found = np.where(pairs > 0.5, products / np.round(pairs), np.nan)
    shifted = np.fft.fftshift(found)
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
