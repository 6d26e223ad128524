r"""Point spread function of polychromatic light.

A share w of the light at a wavelength l has a perfect peak proportional to w / l^2 (light per solid angle), so

    PSF(a) = sum_l w_l PSF_l(a) / l^2 / sum_l w_l / l^2

is normalised to the perfect peak of all the light, as each PSF_l is to its own.
"""

from functools import partial
from typing import Any

import numpy as np

from ..inputs.wavelength import check_spectrum
from .image_errors import intensities, spread_errors
from .point_spread import PointSpread

# Most angles along a side of a grid that is chosen here.
MOST_ANGLES = 4097


def polychromatic_psf(
    wavefront: Any, wavelengths, weights, angle=None, half_width: float | None = None, padding: int = 8
) -> PointSpread:
    """Return the point spread function of all wavelengths on one grid of angles; see `Wavefront.psf`.

    Args:
        wavefront: The wavefront; its OPD holds at all wavelengths.
        wavelengths: Vacuum wavelengths [m], shape (n,).
        weights: Shares of the light, shape (n,); None: equal shares.
        angle: Angles of rows and columns [rad], shape (m,).
        half_width: Greatest angle [rad] if `angle` is None; None takes half of the period of the map's pixels at the
            shortest wavelength.
        padding: Angles per shortest wavelength over the map's width, if `angle` is None.

    Raises:
        ValueError: There are no wavelengths, one is outside 0.1 to 20 um, weights are negative or all zero, or there
            would be too many angles.
    """
    lengths, shares = check_spectrum(wavelengths, weights)
    if angle is None:
        width = len(wavefront.opd) * wavefront.pixel
        if not padding >= 1:
            raise ValueError(f"padding must be at least 1, got {padding!r}")
        reach = 0.5 * lengths.min() / wavefront.pixel if half_width is None else float(half_width)
        steps = reach * width * padding / lengths.min()
        if not 0.0 <= steps <= MOST_ANGLES // 2:
            raise ValueError(
                f"half_width = {half_width!r} rad needs {2.0 * steps:.3g} angles along a side: give `angle`"
            )
        angle = reach / max(int(np.ceil(steps)), 1) * np.arange(-int(np.ceil(steps)), int(np.ceil(steps)) + 1)
    each = [wavefront.at_wavelength(float(length)).psf(angle) for length in lengths]
    share, shortest = mixed_weights(lengths, shares), wavefront.at_wavelength(float(lengths.min()))
    mean = np.tensordot(share, np.stack([one.intensity for one in each]), 1)
    errors = partial(spread_errors, shortest, each[0].angle, partial(_mixed, lengths, share))
    return PointSpread(mean, each[0].angle, errors)


def _mixed(wavelengths: np.ndarray, shares: np.ndarray, wavefront: Any, angle: np.ndarray) -> np.ndarray:
    each = [intensities(wavefront.at_wavelength(float(length)), angle) for length in wavelengths]
    return np.asarray(np.tensordot(shares, np.stack(each), 1))


def mixed_weights(wavelengths: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Return the weights of each wavelength's point spread function in their mean; they sum to 1."""
    weight = shares / wavelengths**2
    return np.asarray(weight / weight.sum())
