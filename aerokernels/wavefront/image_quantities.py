"""Quantities of a wavefront's image with their errors; `Wavefront.image_quantities` describes them."""

from typing import Any

import numpy as np

from ..display.quantities import Quantity
from .image_errors import centroid_errors, sensitivity_error, width_error
from .spot_width import spot_width


def image_quantities(wave: Any, fried: float) -> dict[str, Quantity]:
    """Return "centroid_x", "centroid_y", "fwhm" [rad] and "pssn" of the image of a `Wavefront` with their errors."""
    (x, y), errors = wave.centroid, centroid_errors(wave)
    width, by_sampling = spot_width(wave)
    return {
        "centroid_x": Quantity(float(x), float(errors[0]), "rad"),
        "centroid_y": Quantity(float(y), float(errors[1]), "rad"),
        "fwhm": Quantity(width, float(np.hypot(width_error(wave), by_sampling)), "rad"),
        "pssn": Quantity(wave.pssn(fried), sensitivity_error(wave, fried)),
    }
