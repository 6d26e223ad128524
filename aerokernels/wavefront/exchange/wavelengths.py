"""Image quantities of a wavefront at several wavelengths, as a dataset with a wavelength axis."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ...inputs.wavelength import check_spectrum
from ..data import SIGN_CONVENTION
from ..polychromatic import mixed_weights

if TYPE_CHECKING:
    import xarray


def over_wavelengths(wavefront: Any, wavelengths, angle=None, weights=None) -> "xarray.Dataset":
    """Return the dataset of `Wavefront.over_wavelengths`.

    Raises:
        ValueError: There are no wavelengths, one is outside 0.1 to 20 um, or weights are negative or all zero.
    """
    import xarray

    lengths, shares = check_spectrum(wavelengths, weights)
    if angle is None:
        reach = 4.0 * float(lengths.max()) / (len(wavefront.opd) * wavefront.pixel)
        angle = np.linspace(-reach, reach, 33)
    angle = np.atleast_1d(np.asarray(angle, dtype=np.float64))
    at = [wavefront.at_wavelength(float(length)) for length in lengths]
    strehl = [one.quantities["strehl"] for one in at]
    dims = ("wavelength", "y", "x")
    intensity = np.stack([one.psf(angle).intensity for one in at])
    ratio = {"units": "1", "long_name": "Strehl ratio"}
    width = {"units": "rad", "long_name": "full width at half maximum"}
    mixed = np.tensordot(mixed_weights(lengths, shares), intensity, 1)
    return xarray.Dataset(
        {
            "strehl": ("wavelength", [one.value for one in strehl], ratio),
            "strehl_error": ("wavelength", [one.error for one in strehl], {"units": "1"}),
            "fwhm": ("wavelength", [one.fwhm for one in at], width),
            "psf": (dims, intensity, {"units": "1", "long_name": "over the perfect peak"}),
            "polychromatic_psf": (
                dims[1:],
                mixed,
                {"units": "1", "long_name": "of all the light, over its perfect peak"},
            ),
            "weight": ("wavelength", shares, {"units": "1", "long_name": "share of the light"}),
        },
        {
            "wavelength": ("wavelength", lengths, {"units": "m", "standard_name": "radiation_wavelength"}),
            "x": ("x", angle, {"units": "rad"}),
            "y": ("y", angle, {"units": "rad"}),
        },
        {"sign_convention": SIGN_CONVENTION},
    )
