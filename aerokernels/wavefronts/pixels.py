"""Square grid of pixels of a wavefront over its pupil."""

import math

import numpy as np

from ..inputs.checks import check_count
from ..process.machine import free_memory
from ..pupils import Mask, Projected, Pupil

# A pixel whose covered share is below this share of the greatest one is dropped: it is rounding.
LEAST_COVER = 1e-9


def pupil_grid(pupil: Pupil | Projected, pixel_count: int | None) -> tuple[np.ndarray, float, np.ndarray, np.ndarray]:
    """Return the smallest square grid that holds a pupil.

    Coordinates of the pixels along x and y [m], shape (n,); side of a pixel [m]; mean amplitude and mean intensity of
    each pixel, both (n, n).
    """
    if pixel_count is None:
        pixel_count = 128
        if isinstance(pupil, Mask) and np.ptp(pupil.pixel) == 0.0 and max(pupil.weights.shape) > 1:
            pixel_count = max(pupil.weights.shape)
    pixel_count, half = check_count(pixel_count, "pixel_count", 2), max(pupil.half_extent)
    if pixel_count > (most := math.isqrt(int(free_memory()) // 64)):
        raise ValueError(
            f"pixel_count = {pixel_count} is the number of pixels along one side, and this machine's memory holds "
            f"{most} at most: take a smaller one, such as 256"
        )
    edges = np.linspace(-half, half, pixel_count + 1)
    weight = pupil.coverage(edges, edges)
    weight[weight < LEAST_COVER * weight.max()] = 0.0
    intensity = np.where(weight > 0.0, pupil.coverage(edges, edges, 2), 0.0)
    return 0.5 * (edges[1:] + edges[:-1]), 2.0 * half / pixel_count, weight, intensity


# Finite differences: offset in pixels -> coefficients of the first and the second derivative at offset 0. Central ones
# first, then one-sided ones over three pixels and over two.
STENCILS = (
    {-1: (-0.5, 1.0), 0: (0.0, -2.0), 1: (0.5, 1.0)},
    {0: (-1.5, 1.0), 1: (2.0, -2.0), 2: (-0.5, 1.0)},
    {0: (1.5, 1.0), -1: (-2.0, -2.0), -2: (0.5, 1.0)},
    {0: (-1.0, 0.0), 1: (1.0, 0.0)},
    {0: (1.0, 0.0), -1: (-1.0, 0.0)},
)
REACH = 2


def three_in_a_row(lit: np.ndarray) -> bool:
    """Return whether three pixels in a row or a column have a sample, shape (ny, nx).

    Without them nothing tells how much a wavefront varies within a pixel, and errors due to the pixels are not known.
    """
    return any(bool((one[:-2] & one[1:-1] & one[2:]).any()) for one in (lit, lit.T))


def derivatives(values: np.ndarray, lit: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
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


# Parts of a pixel's side, and their middles from its own [pixels].
PARTS, STEPS = 3, (-1.0 / 3.0, 0.0, 1.0 / 3.0)


def values_of_parts(values: np.ndarray, lit: np.ndarray) -> np.ndarray:
    """Return values at the middles of the parts of pixels, by parabolas along both axes, shape (3 ny, 3 nx)."""
    parts = [values]
    for axis in (0, 1):
        parts = [
            one + step * slope + 0.5 * step**2 * bend
            for one in parts
            for slope, bend in [derivatives(one, lit, axis)]
            for step in STEPS
        ]
    return np.stack(parts).reshape(PARTS, PARTS, *lit.shape).transpose(2, 0, 3, 1).reshape(repeated(lit).shape)


def repeated(values: np.ndarray) -> np.ndarray:
    """Return a value of each pixel for each of its parts."""
    return np.repeat(np.repeat(values, PARTS, axis=0), PARTS, axis=1)
