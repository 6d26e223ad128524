r"""Error of a point spread function due to the pixels of its wavefront.

The amplitude at an angle a is a sum over pixels of w exp(i k (OPD - a x)). Two errors are added as squares:

    the moments    twice the second-order deficit of the shares of edge pixels (pixel_weights.py)
    the folding    a sum over points p apart repeats with the period lambda / p, so the amplitudes at a +- lambda / p
                   are added to the one at a; they belong to light beyond half of a period. They are represented by
                   the amplitudes at half of a period and half a lobe nearer, along the row and along the column of
                   the angle: farther out there is less light. Shares of an area have been averaged over the pixel,
                   which leaves sinc(1 - t) of the amplitudes, at most 2 t, t being the angle between light and ray
                   over a period

If an amplitude is off by d, its intensity I is off by 2 sqrt(I) d + d^2.
"""

from typing import Any

import numpy as np

from .pixel_errors import SAFETY
from .pixel_weights import exact_weights
from .point_spread import complex_amplitude, steady_product


def spread_errors(wavefront: Any, angle: np.ndarray) -> np.ndarray:
    """Return the error due to the pixels of intensities at angles of rows and columns [rad] (m,), shape (m, m)."""
    weight = np.asarray(wavefront.weight)
    exact = exact_weights(weight, wavefront.pixel, wavefront.pupil)
    phase = complex_amplitude(wavefront.opd, wavefront.lit.astype(np.float64), wavefront.wavelength)
    plain, lacking = phase * weight / weight.sum(), phase * (exact / exact.sum() - weight / weight.sum())
    half = 0.5 * wavefront.wavelength / wavefront.pixel
    rim = half * (1.0 - np.array([0.0, 1.0 / len(weight)]))
    kernels = [np.exp(-2j * np.pi / wavefront.wavelength * np.outer(one, wavefront.coordinate)) for one in (angle, rim)]
    inside, outside = kernels

    def amplitude(rows: np.ndarray, wave: np.ndarray, columns: np.ndarray) -> np.ndarray:
        return np.abs(steady_product(steady_product(rows, wave), columns.T)) ** 2

    along_x = sum(amplitude(inside, plain, side).sum(axis=1) for side in (outside, outside.conj()))
    along_y = sum(amplitude(side, plain, inside).sum(axis=0) for side in (outside, outside.conj()))
    left_x, left_y = (
        np.minimum((np.abs(angle) + SAFETY * _slope(wavefront.opd, axis) / wavefront.pixel) / half, 1.0) ** 2
        for axis in (1, 0)
    )
    square = SAFETY**2 * amplitude(inside, lacking, inside)
    square += along_x[:, None] * left_x[None, :] + along_y[None, :] * left_y[:, None]
    return np.asarray(2.0 * np.sqrt(amplitude(inside, plain, inside) * square) + square)


def _slope(opd: np.ndarray, axis: int) -> float:
    """Return the rms OPD step between neighbours along an axis [m]."""
    steps = np.diff(opd, axis=axis)
    steps = steps[np.isfinite(steps)]
    return float(np.sqrt(np.mean(steps**2))) if len(steps) else 0.0
