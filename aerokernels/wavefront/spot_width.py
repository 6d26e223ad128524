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


def spot_width(wavefront: Any) -> tuple[float, float]:
    """Return the full width at half maximum of a `Wavefront` [rad] and its error due to the sampling of the image.

    NaN if all windows are too narrow for it.
    """
    resolution = wavefront.wavelength / (len(wavefront.opd) * wavefront.pixel)
    coarse = wavefront.psf(padding=PADDING)
    place = np.unravel_index(int(np.argmax(coarse.intensity)), coarse.intensity.shape)
    middle = coarse.angle[np.array(place)]
    bright = coarse.angle[np.argwhere(coarse.intensity > NEAR_HALF * coarse.peak)]
    reach = float(np.abs(bright - middle).max()) + resolution / PADDING
    row, column = (float(angle) for angle in middle)
    tilted = wavefront.opd - column * wavefront.coordinate[None, :] - row * wavefront.coordinate[:, None]
    upright, half_width = replace(wavefront, opd=tilted), resolution
    while half_width < reach:
        half_width *= 2.0
    for _ in range(TRIES):
        count = min(int(2.0 * SAMPLES * half_width / resolution), MOST_SAMPLES)
        spread = upright.psf(np.linspace(-half_width, half_width, count + 1))
        width, error = width_at_half(spread.angle, spread.intensity)
        if np.isfinite(width):
            return width, error
        half_width *= 2.0
    return float("nan"), float("nan")


def spot_width_error(wavefront: Any) -> float:
    """Return the error of the width [rad] due to the OPD's error and the sampling of the image, as root sum of squares.

    The former is the greatest change under focus and astigmatism of the OPD error, of either sign.
    """
    error = wavefront.opd_error
    if not np.isfinite(error):
        return float("nan")
    place = wavefront.coordinate / wavefront.radius
    x, y = place[None, :], place[:, None]
    forms = (2.0 * (x**2 + y**2) - 1.0, x**2 - y**2, 2.0 * x * y)
    width, by_sampling = spot_width(wavefront)
    widths = [
        replace(wavefront, opd=wavefront.opd + sign * error * form).fwhm for form in forms for sign in (1.0, -1.0)
    ]
    return float(np.hypot(np.max(np.abs(np.array(widths) - width)), by_sampling))
