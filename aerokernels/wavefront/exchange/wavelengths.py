"""A wavefront at several wavelengths, as a dataset with a wavelength axis."""

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import xarray


def over_wavelengths(wavefront: Any, wavelengths, angle=None) -> "xarray.Dataset":
    """See `Wavefront.over_wavelengths`.

    Raises:
        ValueError: No wavelengths, or one outside 0.1 to 20 um.
    """
    import xarray

    lengths = np.atleast_1d(np.asarray(wavelengths, dtype=np.float64))
    if lengths.ndim != 1 or not len(lengths):
        raise ValueError(f"wavelengths must be numbers [m], shape (n,), got shape {lengths.shape}")
    if angle is None:
        reach = 4.0 * float(lengths.max()) / (len(wavefront.opd) * wavefront.pixel)
        angle = np.linspace(-reach, reach, 33)
    angle = np.atleast_1d(np.asarray(angle, dtype=np.float64))
    at = [wavefront.at_wavelength(float(length)) for length in lengths]
    strehl = [one.quantities["strehl"] for one in at]
    dims = ("wavelength", "y", "x")
    return xarray.Dataset(
        {
            "strehl": ("wavelength", [one.value for one in strehl], {"units": "1", "long_name": "Strehl ratio"}),
            "strehl_error": ("wavelength", [one.error for one in strehl], {"units": "1"}),
            "fwhm": (
                "wavelength",
                [one.fwhm for one in at],
                {"units": "rad", "long_name": "full width at half maximum"},
            ),
            "psf": (
                dims,
                [one.psf(angle).intensity for one in at],
                {"units": "1", "long_name": "over the perfect peak"},
            ),
        },
        {
            "wavelength": ("wavelength", lengths, {"units": "m", "standard_name": "radiation_wavelength"}),
            "x": ("x", angle, {"units": "rad"}),
            "y": ("y", angle, {"units": "rad"}),
        },
        {"sign_convention": "OPD is positive where light is delayed"},
    )
