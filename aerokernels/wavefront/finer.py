"""A wavefront on pixels of half the side, by which the error due to the pixels is told.

A pixel has one sample, at its centre, and the mean amplitude of its area. The OPD at the middles of its quarters is its
Taylor series to second order, with derivatives from the neighbours inside the pupil; the mixed one cancels among the
quarters. Their amplitudes are the pupil's, where the map has one. The OPD, not its phase, is continued: only its slope
tells where the phase advances by nearly a period from pixel to pixel.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from .stencils import derivatives
from .terms import remove_named

# Middles of a pixel's halves, from its own [pixels].
QUARTERS = np.array([-0.25, 0.25])


def finer(wave: Any) -> Any:
    """Return a wavefront on pixels of half the side, with the removed terms fitted and removed again."""
    lit = wave.lit
    opd = np.where(lit, wave.opd, 0.0)
    parts = [opd]
    for axis in (0, 1):
        slope, bend = derivatives(opd, lit, axis)
        parts = [one + step * slope + 0.5 * step**2 * bend for one in parts for step in QUARTERS]
    found = np.empty((2 * len(opd), 2 * len(opd)))
    for number, one in enumerate(parts):  # even and odd rows and columns
        found[number // 2 :: 2, number % 2 :: 2] = one
    weight, intensity = _quartered(wave, wave.weight, 1), _quartered(wave, wave.intensity, 2)
    half = replace(wave, opd=found, weight=weight, intensity=np.maximum(intensity, weight**2), pixel=0.5 * wave.pixel)
    return removed_again(half)


def removed_again(wave: Any) -> Any:
    """Return a wavefront with the terms fitted and removed again that were removed from it."""
    if not wave.removed:
        return wave
    opd = np.full(wave.opd.shape, np.nan)
    opd[wave.lit] = remove_named(*wave.samples, wave.points, wave.removed, wave.radius)
    return replace(wave, opd=opd)


def _quartered(wave: Any, values: np.ndarray, power: int) -> np.ndarray:
    """Return mean amplitudes or intensities (power 2) of the quarters of pixels; their mean is the pixel's own."""
    whole = np.repeat(np.repeat(values, 2, axis=0), 2, axis=1)
    if wave.aperture is None:
        return whole
    count = len(values)
    edges = 0.5 * wave.pixel * (np.arange(2 * count + 1) - count)
    share = wave.aperture.coverage(edges, edges, power)
    mean = share.reshape(count, 2, count, 2).mean(axis=(1, 3))
    mean = np.repeat(np.repeat(mean, 2, axis=0), 2, axis=1)
    return np.where(mean > 0.0, whole * share / np.where(mean > 0.0, mean, 1.0), whole)
