r"""Point spread function of a wavefront, by a discrete Fourier transform of which any part can be computed alone.

    A(a) = sum_x w exp(i k OPD) exp(-i k a x) / sum_x w,      PSF = |A|^2

with a the angle at which light leaves the pupil: OPD = a0 x has its peak at a0. A part of the transform is computed by
two matrix products (R. Soummer et al., Opt. Express 15 (2007) 15935), which give the same values.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..display.shown import shown
from ..inputs.arguments import Numbers, checked
from ..inputs.wavelength import check_wavelength
from .half_maximum import width_at_half

COLUMNS_AT_ONCE = 64  # columns padded and transformed together; affects speed only
BLOCK = 32  # rows and columns of a matrix product: BLAS never splits so small a one among threads


@shown
@dataclass(frozen=True)
class PointSpread:
    """A point spread function.

    Attributes:
        intensity: Intensity over the peak of the undistorted pupil, shape (n, n), axes [y, x] for a map with axes [y,
            x]; its greatest value is the Strehl ratio without tilt.
        angle: Field angles of rows and columns [rad], shape (n,).
        errors: Function that returns the error of each intensity, shape (n, n); `error` calls it.
    """

    intensity: np.ndarray
    angle: np.ndarray
    errors: Callable[[], np.ndarray] | None = field(default=None, repr=False, compare=False)

    @cached_property
    def error(self) -> np.ndarray:
        """Error of each intensity, shape (n, n); NaN if it is not known. Computed when first read."""
        return np.full(self.intensity.shape, np.nan) if self.errors is None else self.errors()

    @property
    def peak(self) -> float:
        """The greatest intensity on the grid."""
        return float(self.intensity.max())

    @property
    def fwhm(self) -> float:
        """Full width at half maximum [rad]: the diameter of the circle with the area above half of the peak.

        NaN if that area reaches the edge of the computed angles.
        """
        return width_at_half(self.angle, self.intensity)[0]

    def plot(self, axes=None, *, decades: float = 4.0):
        """Draw the intensity on matplotlib axes, on a logarithmic scale of so many decades; return the axes."""
        from .plots import plot_point_spread

        return plot_point_spread(self, axes, decades)


def complex_amplitude(opd: np.ndarray, weight: np.ndarray, wavelength: float) -> np.ndarray:
    """Return the field weight exp(i k OPD) of a map, 0 outside the pupil, shape (n, n)."""
    lit = weight > 0.0
    return weight * np.exp(2j * np.pi / wavelength * np.where(lit, opd, 0.0))


def far_field(
    wave: np.ndarray, coordinates: tuple[np.ndarray, np.ndarray], angle: np.ndarray, wavelength: float
) -> np.ndarray:
    """Return the sum of wave exp(-i k a x) at angles a of rows and columns [rad], shape (m, m).

    Args:
        wave: Complex amplitude, shape (rows, columns), axes [y, x].
        coordinates: x of the columns and y of the rows [m].
        angle: Angles [rad], shape (m,).
        wavelength: Wavelength [m].
    """
    along_x, along_y = (np.exp(-2j * np.pi / wavelength * np.outer(angle, axis)) for axis in coordinates)
    return steady_product(steady_product(along_y, wave), along_x.T)


def steady_product(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the product of two matrices, with the same bits on any number of threads.

    BLAS splits a large product among its threads, so that the order of rounding depends on their number. Here BLAS
    multiplies one small block after the other, in a fixed order.
    """
    found = np.zeros((left.shape[0], right.shape[1]), dtype=np.result_type(left, right))
    columns = [np.ascontiguousarray(right[:, at : at + BLOCK]) for at in range(0, right.shape[1], BLOCK)]
    for row in range(0, left.shape[0], BLOCK):
        band = np.ascontiguousarray(left[row : row + BLOCK])
        for begin, column in zip(range(0, right.shape[1], BLOCK), columns, strict=True):
            block = found[row : row + BLOCK, begin : begin + BLOCK]
            for at in range(0, left.shape[1], BLOCK):
                block += band[:, at : at + BLOCK] @ column[at : at + BLOCK]
    return found


def _padded_transform(wave: np.ndarray, size: int, kept: np.ndarray) -> np.ndarray:
    """Return the rows `kept`, shape (m, columns), of the discrete Fourier transform of columns padded to a size.

    By FFT, since the last bits of a BLAS product depend on the number of threads; in blocks, to save memory.
    """
    found = np.empty((len(kept), wave.shape[1]), dtype=np.complex128)
    for begin in range(0, wave.shape[1], COLUMNS_AT_ONCE):
        block = slice(begin, begin + COLUMNS_AT_ONCE)
        found[:, block] = np.fft.fft(np.ascontiguousarray(wave[:, block].T), size, axis=1)[:, kept].T
    return found


@checked
def point_spread_function(
    opd: Numbers,
    mask: Numbers,
    pixel: float,
    wavelength: float,
    *,
    padding: int = 8,
    half_width: float | None = None,
    angle: Numbers | None = None,
) -> PointSpread:
    """Return the point spread function of a wavefront on a square grid, by the discrete Fourier transform of the pupil.

    Args:
        opd: Optical path difference on a square grid [m], shape (n, n); values outside `mask` are ignored.
        mask: Transmission of the pupil (0 to 1), shape (n, n).
        pixel: Grid spacing [m].
        wavelength: Wavelength [m].
        padding: Samples per wavelength / diameter: the pupil is padded to this many times its size.
        half_width: Greatest field angle [rad], along either axis; None for all.
        angle: Field angles of both rows and columns [rad], shape (m,); replaces `padding` and `half_width`.

    Raises:
        TypeError: The wavelength is not a number.
        ValueError: Shapes disagree, the pupil is empty, the wavelength is outside 0.1 to 20 um, or a number is out of
            range.
    """
    opd, mask = np.asarray(opd, dtype=np.float64), np.asarray(mask, dtype=np.float64)
    if opd.ndim != 2 or opd.shape[0] != opd.shape[1] or opd.shape != mask.shape:
        raise ValueError(f"opd and mask must be square and have the same shape, got {opd.shape} and {mask.shape}")
    wavelength = check_wavelength(wavelength)
    if not (np.isfinite(pixel) and pixel > 0.0 and padding >= 1):
        raise ValueError(f"pixel and padding must be positive, got {pixel!r} m and {padding!r}")
    if half_width is not None and not half_width >= 0.0:
        raise ValueError(f"half_width must be an angle of at least 0 rad, or None, got {half_width!r}")
    if not np.isfinite(mask).all() or (mask < 0.0).any():
        raise ValueError("the mask must be finite and not negative: it is the transmission of the pupil, 0 to 1")
    lit = mask > 0.0
    if not lit.any() or not np.isfinite(opd[lit]).all():
        raise ValueError("the pupil must not be empty and the wavefront in it must be finite")
    count = opd.shape[0]
    size = int(count * padding)
    wave = complex_amplitude(opd, mask, wavelength)
    if angle is not None:
        angle = np.atleast_1d(np.asarray(angle, dtype=np.float64))
        if angle.ndim != 1 or not np.isfinite(angle).all():
            raise ValueError(f"angle must be finite angles [rad], shape (m,), got shape {angle.shape}")
        coordinate = pixel * (np.arange(count) - 0.5 * (count - 1))
        amplitude = far_field(wave, (coordinate, coordinate), angle, wavelength)
        return PointSpread(np.abs(amplitude) ** 2 / mask.sum() ** 2, angle)
    angle = np.fft.fftshift(np.fft.fftfreq(size, pixel)) * wavelength
    if half_width is None:
        amplitude = np.fft.fftshift(np.fft.fft2(wave, (size, size)))
    else:
        shown = np.abs(angle) <= half_width
        angle = angle[shown]
        kept = (np.arange(size)[shown] - size // 2) % size
        amplitude = _padded_transform(_padded_transform(wave, size, kept).T, size, kept).T
    return PointSpread(np.abs(amplitude) ** 2 / mask.sum() ** 2, angle)
