r"""Error of a point spread function due to the pixels of its wavefront.

The amplitude at an angle a is a sum over pixels of w exp(i k (OPD - a x)). Three errors are added as squares:

    the moments    twice the second-order deficit of the shares of edge pixels (pixel_weights.py)
    the halves     twice the change with pixels of half the side (half_pixels.py)
    the folding    a sum over points p apart repeats with the period lambda / p, so the amplitudes at a +- lambda / p
                   are added to the one at a; they belong to light beyond half of a period. They are represented by
                   the mean intensity over two lobes up to half of a period, along the row and along the column of the
                   angle and of angles half a lobe beside it: at a single angle the amplitudes of both sides may
                   cancel, and farther out there is less light. Shares of an area have been averaged over the pixel,
                   which leaves sinc(1 - t) of the amplitudes, at most 2 t, t being the angle between light and ray
                   over a period

If an amplitude is off by d, its intensity I is off by 2 sqrt(I) d + d^2.
"""

from typing import Any

import numpy as np

from .half_pixels import QUARTERS, halved
from .pixel_errors import SAFETY
from .pixel_weights import exact_weights, three_in_a_row
from .point_spread import complex_amplitude, steady_product

# Where light beyond half of a period is read: half a lobe apart along and across the row or column of an angle.
NEARER, ABOUT = 4, np.array([-1.0, 0.0, 1.0])


def spread_errors(wavefront: Any, angle: np.ndarray) -> np.ndarray:
    """Return errors due to the pixels of intensities at angles [rad] (m,), shape (m, m); NaN if not known."""
    if not three_in_a_row(wavefront.lit):
        return np.full((len(angle), len(angle)), np.nan)
    weight = np.asarray(wavefront.weight)
    exact = exact_weights(weight, wavefront.pixel, wavefront.aperture)
    phase = complex_amplitude(wavefront.opd, wavefront.lit.astype(np.float64), wavefront.wavelength)
    plain, lacking = phase * weight / weight.sum(), phase * (exact / exact.sum() - weight / weight.sum())
    finer, shares = halved(wavefront)
    finest = complex_amplitude(finer, shares / shares.sum(), wavefront.wavelength)
    half = 0.5 * wavefront.wavelength / wavefront.pixel
    apart = half / len(weight)  # half a lobe of the whole map
    place = wavefront.coordinate
    inside = _kernel(wavefront, place, angle)
    by_halves = _kernel(wavefront, np.add.outer(place, QUARTERS * wavefront.pixel).ravel(), angle)
    about = _kernel(wavefront, place, np.add.outer(ABOUT * apart, angle).ravel())
    rim = _kernel(wavefront, place, half - apart * np.arange(NEARER))

    def between(rows: np.ndarray, wave: np.ndarray, columns: np.ndarray) -> np.ndarray:
        return steady_product(steady_product(rows, wave), columns.T)

    def amplitude(rows: np.ndarray, wave: np.ndarray, columns: np.ndarray) -> np.ndarray:
        return np.abs(between(rows, wave, columns)) ** 2

    def beyond(wave: np.ndarray) -> np.ndarray:
        found = sum(amplitude(about, wave, side).mean(axis=1) for side in (rim, rim.conj()))
        return 2.0 * np.mean(np.reshape(found, (len(ABOUT), -1)), axis=0)

    along_x, along_y = beyond(plain), beyond(plain.T)
    left_x, left_y = (
        np.minimum((np.abs(angle) + SAFETY * _slope(wavefront.opd, axis) / wavefront.pixel) / half, 1.0) ** 2
        for axis in (1, 0)
    )
    square = SAFETY**2 * amplitude(inside, lacking, inside)
    square += along_x[:, None] * left_x[None, :] + along_y[None, :] * left_y[:, None]
    seen = between(inside, plain, inside)
    square += np.abs(SAFETY * (between(by_halves, finest, by_halves) - seen)) ** 2
    return np.asarray(2.0 * np.abs(seen) * np.sqrt(square) + square)


def _kernel(wavefront: Any, place: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return exp(-i k a x) of angles [rad] and coordinates [m], shape (angles, coordinates)."""
    return np.exp(-2j * np.pi / wavefront.wavelength * np.outer(angle, place))


def _slope(opd: np.ndarray, axis: int) -> float:
    """Return the rms OPD step between neighbours along an axis [m]."""
    steps = np.diff(opd, axis=axis)
    steps = steps[np.isfinite(steps)]
    return float(np.sqrt(np.mean(steps**2))) if len(steps) else 0.0
