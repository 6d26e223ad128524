"""Quantities of a wavefront's image with their errors; `Wavefront.image_quantities` describes them."""

from typing import Any

import numpy as np

from ..display.quantities import Quantity
from .image_errors import centroid_errors, grid_errors, sensitivity_errors
from .spot_width import spot_width_error


def image_quantities(wave: Any, fried: float) -> dict[str, Quantity]:
    """Return "centroid_x", "centroid_y", "fwhm" [rad] and "pssn" of the image of a `Wavefront` with their errors."""
    phase, pssn = wave.phase_error(), wave.pssn(fried)
    x, y = wave.centroid
    errors = centroid_errors(wave)
    pixels = float(grid_errors(wave, lambda one: one.fwhm))
    sensitivity = sensitivity_errors(wave, fried)

    def number(value: float, *errors: float, unit: str = "") -> Quantity:
        return Quantity(float(value), float(np.linalg.norm(errors)), unit)

    return {
        "centroid_x": number(x, errors[0], unit="rad"),
        "centroid_y": number(y, errors[1], unit="rad"),
        "fwhm": number(wave.fwhm, spot_width_error(wave), pixels, unit="rad"),
        "pssn": number(pssn, 4.0 * phase + 4.0 * phase**2, float(sensitivity)),
    }
