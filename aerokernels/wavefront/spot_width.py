"""Full width at half maximum of the point spread function of a wavefront.

A coarse PSF over all angles shows where the peak is, and how far from it other places come near half of the peak. A
window of that width about the peak is computed finely; if half of the peak reaches its edge, a window twice as wide is
tried.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from .half_maximum import width_at_half

# Samples per resolution element; most samples across the window; number of windows tried.
SAMPLES, MOST_SAMPLES, TRIES = 64, 1024, 8
# Samples of the coarse PSF per resolution element; share of its peak that may be half of the true peak.
PADDING, NEAR_HALF = 4, 0.4


def spot_width(wave: Any) -> tuple[float, float]:
    """Return the full width at half maximum of a `Wavefront` [rad] and its error due to the sampling of the image.

    NaN if all windows are too narrow for it.
    """
    found = _searched(wave)
    return found[2:] if found else (float("nan"), float("nan"))


def spot_window(wave: Any) -> tuple[np.ndarray, float] | None:
    """Return the middle of the window that holds the spot, along y and x [rad], and its half width [rad]."""
    found = _searched(wave)
    return found[:2] if found else None


def _searched(wave: Any) -> tuple[np.ndarray, float, float, float] | None:
    """Return middle and half width of the window, the spot's width and the width's error [rad]; None without one."""
    resolution = wave.wavelength / (len(wave.opd) * wave.pixel)
    coarse = wave.psf(padding=PADDING)
    place = np.unravel_index(int(np.argmax(coarse.intensity)), coarse.intensity.shape)
    middle = coarse.angle[np.array(place)]
    bright = coarse.angle[np.argwhere(coarse.intensity > NEAR_HALF * coarse.peak)]
    reach = float(np.abs(bright - middle).max()) + resolution / PADDING
    row, column = (float(angle) for angle in middle)
    tilted = wave.opd - column * wave.coordinate[None, :] - row * wave.coordinate[:, None]
    upright, half_width = replace(wave, opd=tilted), resolution
    while half_width < reach:
        half_width *= 2.0
    for _ in range(TRIES):
        count = min(int(2.0 * SAMPLES * half_width / resolution), MOST_SAMPLES)
        spread = upright.psf(np.linspace(-half_width, half_width, count + 1))
        width, error = width_at_half(spread.angle, spread.intensity)
        if np.isfinite(width):
            return middle, half_width, width, error
        half_width *= 2.0
    return None
