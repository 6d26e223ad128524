"""A wavefront on pixels of a third of the side, by which the error due to the pixels is told.

A pixel has one sample, at its centre, and the mean amplitude of its area. The OPD within it is its Taylor series to
second order along either axis, with derivatives from the neighbours inside the pupil; amplitudes there are the pupil's,
where the map has one. The OPD, not its phase, is continued: only its slope tells where the phase advances by nearly a
period from pixel to pixel.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from .stencils import derivatives
from .terms import remove_named

# Parts of a pixel's side, and their middles from its own [pixels].
PARTS, STEPS = 3, (-1.0 / 3.0, 0.0, 1.0 / 3.0)


def finer(wave: Any) -> Any:
    """Return a wavefront on pixels of a third of the side, with the removed terms fitted and removed again."""
    lit = wave.lit
    parts = [np.where(lit, wave.opd, 0.0)]
    for axis in (0, 1):
        parts = [
            one + step * slope + 0.5 * step**2 * bend
            for one in parts
            for slope, bend in [derivatives(one, lit, axis)]
            for step in STEPS
        ]
    found = np.stack(parts).reshape(PARTS, PARTS, *lit.shape).transpose(2, 0, 3, 1).reshape(_repeated(lit).shape)
    weight, intensity = _divided(wave, wave.weight, 1), _divided(wave, wave.intensity, 2)
    intensity = np.maximum(intensity, weight**2)
    return removed_again(replace(wave, opd=found, weight=weight, intensity=intensity, pixel=wave.pixel / PARTS))


def removed_again(wave: Any) -> Any:
    """Return a wavefront with the terms fitted and removed again that were removed from it."""
    if not wave.removed:
        return wave
    opd = np.full(wave.opd.shape, np.nan)
    path, weight = wave.samples
    opd[wave.lit] = remove_named(path, weight, wave.points, wave.removed, wave.radius)
    return replace(wave, opd=opd)


def _divided(wave: Any, values: np.ndarray, power: int) -> np.ndarray:
    """Return mean amplitudes or intensities (power 2) of the parts of pixels; their mean is the pixel's own."""
    whole, count = _repeated(values), len(values)
    if wave.aperture is None:
        return whole
    edges = wave.pixel / PARTS * (np.arange(PARTS * count + 1) - 0.5 * PARTS * count)
    share = wave.aperture.coverage(edges, edges, power)
    mean = _repeated(share.reshape(count, PARTS, count, PARTS).mean(axis=(1, 3)))
    return np.where(mean > 0.0, whole * share / np.where(mean > 0.0, mean, 1.0), whole)


def _repeated(values: np.ndarray) -> np.ndarray:
    return np.repeat(np.repeat(values, PARTS, axis=0), PARTS, axis=1)
