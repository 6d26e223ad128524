"""Power spectra in time, by Welch's averaged periodograms, one-sided: their integral over frequency is the variance."""

from dataclasses import dataclass

import numpy as np

from .uncertainty import spread_share

EVEN = 1e-3  # greatest relative deviation of time steps from even ones
LEAST_SEGMENT = 8
COLUMNS = 256  # processed together
SEGMENTS = 8  # default number of half-overlapping segments


@dataclass(frozen=True, eq=False)
class Spectrum:
    """A power spectral density.

    Attributes:
        frequency: [Hz], shape (f,).
        density: [square of the unit / Hz], shape (f, ...).
        error: Its standard error, of the same shape.
        segment_count: Number of independent segments averaged.
    """

    frequency: np.ndarray
    density: np.ndarray
    error: np.ndarray
    segment_count: float


def sample_rate(time: np.ndarray) -> float:
    """Return the samples per second of even times [s].

    Raises:
        ValueError: Times that are not even, or too few.
    """
    if len(time) < 2 * LEAST_SEGMENT:
        raise ValueError(f"spectra need at least {2 * LEAST_SEGMENT} snapshots, there are {len(time)}")
    steps = np.diff(time)
    if np.abs(steps - steps.mean()).max() > EVEN * steps.mean():
        raise ValueError("spectra need even times: interpolate the series in time first")
    return float(1.0 / steps.mean())


def welch(values: np.ndarray, rate: float, segment: int | None = None) -> Spectrum:
    """Return the spectrum of samples along the first axis, with their mean subtracted.

    Args:
        values: Samples, shape (n, ...).
        rate: Samples per second.
        segment: Samples of a segment; None takes a length that gives about eight of them.

    Raises:
        ValueError: A segment that is longer than the series, or below eight samples.
    """
    from scipy import signal

    count = len(values)
    length = max(LEAST_SEGMENT, 2 * count // (SEGMENTS + 1)) if segment is None else int(segment)
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
        (welch(values[:, k : k + COLUMNS], rate, segment), weight[k : k + COLUMNS])
        for k in range(0, values.shape[1], COLUMNS)
    ]
    density, error = (np.sum([getattr(one, name) @ own for one, own in parts], axis=0) for name in ("density", "error"))
    first = parts[0][0]
    return Spectrum(first.frequency, density, error, first.segment_count)
