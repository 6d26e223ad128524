r"""What the pixels of a wavefront make its point spread function off by.

The amplitude at an angle a is a sum over pixels of w exp(i k (OPD - a x)). Two causes, added as squares:

    the moments    what the shares of edge pixels lack in second order (pixel_weights.py), twice
    the folding    a sum over places p apart repeats with the period lambda / p: to the amplitude at a are added those
                   at a +- lambda / p, whose light lies beyond half of a period. What lies at half of it, and half a
                   lobe nearer, along the row and along the column of the angle stands for them: farther out is less.
                   Shares of an area have been folded with the pixel, which leaves sinc(1 - t) of them, at most 2 t, t
                   being the angle between light and ray over a period

Of an amplitude that is off by d, the intensity I is off by 2 sqrt(I) d + d^2.
"""

from typing import Any

import numpy as np

from .pixel_errors import SAFETY
from .pixel_weights import exact_weights
from .point_spread import steady_product


def spread_errors(wavefront: Any, angle: np.ndarray) -> np.ndarray:
    """What intensities at angles of rows and columns [rad], shape (m,), are off by for the pixels, shape (m, m)."""
    weight = np.asarray(wavefront.weight)
    exact = exact_weights(weight, wavefront.pixel, wavefront.pupil)
    phase = np.exp(2j * np.pi / wavefront.wavelength * np.where(wavefront.lit, wavefront.opd, 0.0))
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
    """Rms step between neighbours along an axis [m]."""
    steps = np.diff(opd, axis=axis)
    steps = steps[np.isfinite(steps)]
    return float(np.sqrt(np.mean(steps**2))) if len(steps) else 0.0
