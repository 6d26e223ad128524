r"""A map on pixels of half the side, for the error that pixels make: the phase varies within a pixel.

A sum over pixels takes one phase for each. Where the phase advances by nearly a period from pixel to pixel the samples
look alike, as if it did not vary at all, on any coarser grid too: only its slope, which the optical path has and its
phase has not, tells them apart. The path at the middles of a pixel's quarters is its Taylor series to second order,
with derivatives from the neighbours inside the pupil; the mixed one cancels among the quarters.
"""

from typing import Any

import numpy as np

from .pixel_weights import REACH, STENCILS

# Middles of a pixel's halves, from its own [pixels].
QUARTERS = np.array([-0.25, 0.25])


def halved(wavefront: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return OPD [m] and amplitude weights of a wavefront on pixels of half the side, both of shape (2 n, 2 n).

    The weights of a pixel's quarters have the pixel's weight as their mean.
    """
    lit = wavefront.lit
    opd = np.where(lit, wavefront.opd, 0.0)
    parts = [opd]
    for axis in (0, 1):
        slope, bend = _derivatives(opd, lit, axis)
        steps = [step * slope + 0.5 * step**2 * bend for step in QUARTERS]
        parts = [one + step for one in parts for step in steps]
    weight = np.asarray(wavefront.weight)
    found = _interleaved([np.where(lit, one, 0.0) for one in parts])
    whole = np.repeat(np.repeat(weight, 2, axis=0), 2, axis=1)
    if wavefront.aperture is None:
        return found, whole
    rows, columns = weight.shape
    side = 0.5 * wavefront.pixel
    edges = [side * (np.arange(2 * count + 1) - count) for count in (columns, rows)]
    share = wavefront.aperture.coverage(*edges)
    mean = np.repeat(np.repeat(share.reshape(rows, 2, columns, 2).mean(axis=(1, 3)), 2, axis=0), 2, axis=1)
    return found, np.where(mean > 0.0, whole * share / np.where(mean > 0.0, mean, 1.0), whole)


def _interleaved(parts: list[np.ndarray]) -> np.ndarray:
    """Return a map from those of its even and odd rows and columns, in the order (0, 0), (0, 1), (1, 0), (1, 1)."""
    rows, columns = parts[0].shape
    found = np.empty((2 * rows, 2 * columns))
    for number, one in enumerate(parts):
        found[number // 2 :: 2, number % 2 :: 2] = one
    return found


def _derivatives(values: np.ndarray, lit: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Return first and second derivatives along an axis, per pixel and pixel squared; 0 without neighbours."""
    values, free = (np.pad(array, REACH) for array in (values, lit))
    there = free.copy()
    slope, bend = np.zeros(values.shape), np.zeros(values.shape)
    for stencil in STENCILS:
        taken = free.copy()
        for place in stencil:
            taken &= np.roll(there, -place, axis)
        free &= ~taken
        for place, (first, second) in stencil.items():
            at = np.where(taken, np.roll(values, -place, axis), 0.0)
            slope += first * at
            bend += second * at
    inner = slice(REACH, -REACH)
    return slope[inner, inner], bend[inner, inner]
