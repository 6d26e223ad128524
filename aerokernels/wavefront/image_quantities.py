"""Quantities of a wavefront's image with their errors; `Wavefront.image_quantities` describes them."""

from typing import Any

import numpy as np

from ..display.quantities import Quantity
from .image_errors import grid_errors, transfer_errors
from .modes import centroid_weights
from .pixel_errors import pixel_errors
from .spot_width import spot_width_error
from .transfer import normalised_sensitivity


def image_quantities(wave: Any, fried: float) -> dict[str, Quantity]:
    """Return "centroid_x", "centroid_y", "fwhm" [rad] and "pssn" of the image of a `Wavefront` with their errors."""
    phase, pssn = wave.phase_error(), wave.pssn(fried)
    x, y = wave.centroid
    rims = wave.opd_error * np.abs(centroid_weights(wave)).sum(axis=(1, 2))
    edges = pixel_errors(wave)
    pixels = grid_errors(wave, lambda one: (*one.centroid, one.fwhm))
    sensitivity = transfer_errors(wave, lambda otf: normalised_sensitivity(otf, wave.wavelength, fried))

    def number(value: float, *errors: float, unit: str = "") -> Quantity:
        return Quantity(float(value), float(np.linalg.norm(errors)), unit)

    return {
        "centroid_x": number(x, rims[0], edges["tilt_x"], pixels[0], unit="rad"),
        "centroid_y": number(y, rims[1], edges["tilt_y"], pixels[1], unit="rad"),
        "fwhm": number(wave.fwhm, spot_width_error(wave), pixels[2], unit="rad"),
        "pssn": number(pssn, 4.0 * phase + 4.0 * phase**2, float(sensitivity)),
    }
