"""The point spread function of a wavefront, by a discrete Fourier transform of which parts can be had by themselves."""

from dataclasses import dataclass

import numpy as np

from ..wavelength import check_wavelength


@dataclass(frozen=True)
class PointSpread:
    """A point spread function.

    Attributes:
        intensity: Intensity over the peak of the undistorted pupil, shape (n, n); its greatest value is the Strehl
            ratio when tilt is left out of account.
        angle: Field angles of rows and columns [rad], shape (n,).
    """

    intensity: np.ndarray
    angle: np.ndarray


def point_spread_function(
    opd, mask, pixel: float, wavelength: float, *, padding: int = 8, half_width: float | None = None
) -> PointSpread:
    """Point spread function of a wavefront on a square grid, by the discrete Fourier transform of the pupil.

    A few rings need a small part of the transform only: with `half_width` that part is computed as two products with
    matrices (R. Soummer et al., Opt. Express 15 (2007) 15935), which gives the same values.

    Args:
        opd: Optical path difference on a square grid [m], shape (n, n); values outside `mask` are ignored.
        mask: Transmission of the pupil (0 to 1), shape (n, n).
        pixel: Grid spacing [m].
        wavelength: Wavelength [m].
        padding: Samples per wavelength / diameter: the pupil is padded to this many times its size.
        half_width: Greatest field angle wanted [rad], along either axis; None for all.

    Raises:
        TypeError: The wavelength is not one number.
        ValueError: Shapes that disagree, an empty pupil, a wavelength outside 0.1 to 20 um, numbers that make no sense.
    """
    opd, mask = np.asarray(opd, dtype=np.float64), np.asarray(mask, dtype=np.float64)
    if opd.ndim != 2 or opd.shape[0] != opd.shape[1] or opd.shape != mask.shape:
        raise ValueError(f"opd and mask must be square and of one shape, got {opd.shape} and {mask.shape}")
    wavelength = check_wavelength(wavelength)
    if not (np.isfinite(pixel) and pixel > 0.0 and padding >= 1):
        raise ValueError(f"pixel and padding must be positive, got {pixel!r} m and {padding!r}")
    if half_width is not None and not half_width >= 0.0:
        raise ValueError(f"half_width must be an angle of at least 0 rad, or None, got {half_width!r}")
    lit = mask > 0.0
    if not lit.any() or not np.isfinite(opd[lit]).all():
        raise ValueError("the pupil must not be empty and the wavefront in it must be finite")
    count = opd.shape[0]
    size = int(count * padding)
    field = mask * np.exp(2j * np.pi / wavelength * np.where(lit, opd, 0.0))
    angle = np.fft.fftshift(np.fft.fftfreq(size, pixel)) * wavelength
    if half_width is None:
        amplitude = np.fft.fftshift(np.fft.fft2(field, (size, size)))
    else:
        shown = np.abs(angle) <= half_width
        angle = angle[shown]
        frequency = np.arange(size)[shown] - size // 2
        # Whole turns are taken out in whole numbers, so that the phase is exact.
        turn = np.outer(frequency, np.arange(count)) % size
        transform = np.exp(-2j * np.pi / size * turn)
        amplitude = transform @ field @ transform.T
    return PointSpread(np.abs(amplitude) ** 2 / mask.sum() ** 2, angle)
