"""Export to HCIPy, which has the same signs and order of axes as aerokernels."""

import numpy as np

from ..data import WavefrontMap
from ..point_spread import complex_amplitude
from .packages import package


def to_hcipy(wavefront: WavefrontMap):
    """Return a hcipy.Wavefront of the field w exp(i k OPD) on a regular grid in metres, x running fastest.

    Its `electric_field` is a hcipy.Field, which hcipy.write_field saves as ASDF. FITS files have no complex numbers:
    save its `amplitude` and its `phase`.

    Raises:
        ModuleNotFoundError: hcipy is not installed.
    """
    hcipy = package("hcipy")
    count, pixel = len(wavefront.opd), wavefront.pixel
    first = float(wavefront.coordinate[0])
    grid = hcipy.CartesianGrid(hcipy.RegularCoords([pixel, pixel], [count, count], [first, first]))
    field = complex_amplitude(wavefront.opd, wavefront.weight, wavefront.wavelength)
    return hcipy.Wavefront(hcipy.Field(np.ravel(field), grid), wavefront.wavelength)
