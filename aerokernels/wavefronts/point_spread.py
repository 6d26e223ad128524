r"""Point spread function of a wavefront, by a discrete Fourier transform of which any part can be computed alone.

    A(a) = sum_x w exp(i k OPD) exp(-i k a x) / sum_x w,      PSF = |A|^2

a being the angle at which light leaves the pupil (parts by matrix products: R. Soummer, Opt. Express 15 (2007) 15935).
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..display.shown import drawn_on, extent_of, shown
from ..inputs.arguments import Numbers, checked
from ..inputs.checks import check_spectrum, check_wavelength
from .changes import of_map

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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

    def plot(self, axes: "Axes | None" = None, *, decades: float = 4.0) -> "Axes":
        """Draw the intensity on matplotlib axes, on a logarithmic scale of so many decades; return the axes."""
        axes = drawn_on(axes)
        shown = np.log10(np.maximum(self.intensity, self.peak * 10.0**-decades))
        extent = extent_of(1e6 * self.angle, 1e6 * self.angle)
        picture = axes.imshow(shown, origin="lower", extent=extent, cmap="inferno")
        axes.figure.colorbar(picture, ax=axes, label="log10 of intensity over the perfect peak")
        axes.set(xlabel="field angle x [urad]", ylabel="field angle y [urad]")
        return axes


def complex_amplitude(opd: np.ndarray, weight: np.ndarray, wavelength: float) -> np.ndarray:
    """Return the field weight exp(i k OPD) of a map, 0 outside the pupil, shape (n, n)."""
    lit = weight > 0.0
    return weight * np.exp(2j * np.pi / wavelength * np.where(lit, opd, 0.0))


def far_field(
    wave: np.ndarray, coordinates: tuple[np.ndarray, np.ndarray], angle: np.ndarray, wavelength: float
) -> np.ndarray:
    """Return the sum of wave exp(-i k a x) at angles a of rows and columns [rad], (m, m); coordinates x, y [m]."""
    along_x, along_y = (np.exp(-2j * np.pi / wavelength * np.outer(angle, axis)) for axis in coordinates)
    return steady_product(steady_product(along_y, wave), along_x.T)


def steady_product(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the product of two matrices, with the same bits on any number of threads."""
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
    """Return the rows `kept`, shape (m, columns), of the discrete Fourier transform of columns padded to a size."""
    found = np.empty((len(kept), wave.shape[1]), dtype=np.complex128)
    for begin in range(0, wave.shape[1], 64):
        block = slice(begin, begin + 64)
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
        ValueError: Shapes disagree, the pupil is empty, the wavelength is outside 0.1 to 24 um, or a number is out of
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


def width_at_half(angle: np.ndarray, intensity: np.ndarray) -> tuple[float, float]:
    """Return the full width at half maximum [rad] and its error due to the sampling; NaN if it reaches the edge.

    The area above half of the maximum is within contours through the samples; every second sample gives a better one
    (Richardson) and its error. The maximum is a paraboloid's through the greatest sample and its neighbours.
    """
    half = 0.5 * _maximum(angle, intensity)
    if max(intensity[0].max(), intensity[-1].max(), intensity[:, 0].max(), intensity[:, -1].max()) >= half:
        return float("nan"), float("nan")
    area = _area_above(half, angle, intensity)
    width = _diameter(area)
    if len(angle) < 9:  # every second sample does not show a spot: the error may be as great as the width
        return width, width
    coarse = _area_above(half, angle[::2], intensity[::2, ::2])
    found = _diameter(area + (area - coarse) / 3.0)
    return found, abs(found - width)


def _diameter(area: float) -> float:
    return 2.0 * float(np.sqrt(abs(area) / np.pi))


def _area_above(level: float, angle: np.ndarray, intensity: np.ndarray) -> float:
    from contourpy import contour_generator

    # Closed contour lines have the higher side to their left, so that holes count negative.
    area = 0.0
    for line in contour_generator(angle, angle, intensity).lines(level):
        x, y = np.asarray(line).T
        area += 0.5 * float(np.sum(x[:-1] * np.diff(y) - y[:-1] * np.diff(x)))
    return area


def _maximum(angle: np.ndarray, intensity: np.ndarray) -> float:
    """Return the greatest intensity between the samples: of a paraboloid about the greatest sample, if it has one."""
    row, column = np.unravel_index(int(np.argmax(intensity)), intensity.shape)
    greatest = float(intensity[row, column])
    if not (0 < row < len(angle) - 1 and 0 < column < len(angle) - 1):
        return greatest
    about = intensity[row - 1 : row + 2, column - 1 : column + 2]
    up, right = (angle[place - 1 : place + 2] - angle[place] for place in (row, column))
    y, x = np.meshgrid(up, right, indexing="ij")
    step = float(max(np.abs(up).max(), np.abs(right).max()))
    x, y = x.ravel() / step, y.ravel() / step
    terms = np.stack([np.ones(9), x, y, x * x, x * y, y * y], axis=1)
    level, in_x, in_y, xx, xy, yy = np.linalg.lstsq(terms, about.ravel(), rcond=None)[0].tolist()
    curved = 4.0 * xx * yy - xy * xy
    if not (xx < 0.0 < curved):
        return greatest
    place = (xy * in_y - 2.0 * yy * in_x) / curved, (xy * in_x - 2.0 * xx * in_y) / curved
    if max(map(abs, place)) > 1.0:
        return greatest
    return max(greatest, level + 0.5 * (in_x * place[0] + in_y * place[1]))


@checked
def psf(
    wave: Any,
    /,
    angle: Numbers | None = None,
    *,
    half_width: float | None = None,
    padding: int = 8,
    wavelengths: Numbers | None = None,
    weights: Numbers | None = None,
) -> PointSpread:
    """Return the point spread function over the peak of the perfect one; arguments as in `point_spread_function`.

    With `wavelengths` [m], shape (n,), it is the one of polychromatic light with this OPD at all wavelengths.
    `weights` are the shares of the light at the wavelengths, equal if None.
    """
    if wavelengths is not None or weights is not None:
        return polychromatic_psf(wave, wavelengths, weights, angle, half_width, padding)
    options: dict[str, Any] = {"half_width": half_width, "padding": padding, "angle": angle}
    found = point_spread_function(wave.opd, wave.weight, wave.pixel, wave.wavelength, **options)
    return replace(found, errors=partial(spread_errors, wave, found.angle, intensities))


def polychromatic_psf(
    wavefront: Any, wavelengths, weights, angle=None, half_width: float | None = None, padding: int = 8
) -> PointSpread:
    """Return the point spread function of all wavelengths on one grid of angles; arguments as in `Wavefront.psf`."""
    lengths, shares = check_spectrum(wavelengths, weights)
    shortest = float(lengths.min())
    if angle is None:
        if not padding >= 1:
            raise ValueError(f"padding must be at least 1, got {padding!r}")
        reach = 0.5 * shortest / wavefront.pixel if half_width is None else float(half_width)
        steps = reach * len(wavefront.opd) * wavefront.pixel * padding / shortest
        if not 0.0 <= steps <= 4097 // 2:
            raise ValueError(
                f"half_width = {half_width!r} rad needs {2.0 * steps:.3g} angles along a side: give `angle`"
            )
        angle = reach / max(int(np.ceil(steps)), 1) * np.arange(-int(np.ceil(steps)), int(np.ceil(steps)) + 1)
    each = [wavefront.at_wavelength(float(length)).psf(angle) for length in lengths]
    share = shares / lengths**2
    share /= share.sum()
    mean = np.tensordot(share, np.stack([one.intensity for one in each]), 1)
    errors = partial(spread_errors, wavefront.at_wavelength(shortest), each[0].angle, partial(_mixed, lengths, share))
    return PointSpread(mean, each[0].angle, errors)


def _mixed(wavelengths: np.ndarray, shares: np.ndarray, wave: Any, angle: np.ndarray) -> np.ndarray:
    each = [intensities(wave.at_wavelength(float(length)), angle) for length in wavelengths]
    return np.asarray(np.tensordot(shares, np.stack(each), 1))


def intensities(wave: Any, angle: np.ndarray) -> np.ndarray:
    """Return the point spread function of a wavefront at angles of rows and columns [rad] (m,), shape (m, m)."""
    kernel = np.exp(-2j * np.pi / wave.wavelength * np.outer(angle, wave.coordinate))
    amplitude = kernel @ complex_amplitude(wave.opd, wave.weight, wave.wavelength) @ kernel.T
    return np.asarray(np.abs(amplitude) ** 2 / wave.weight.sum() ** 2)


def spread_errors(wave: Any, angle: np.ndarray, number: Callable[[Any, np.ndarray], np.ndarray]) -> np.ndarray:
    """Return the errors of intensities at angles of rows and columns [rad] (m,), shape (m, m).

    `number` returns the intensities of a wavefront at angles. Where there are many, errors are interpolated between
    two per resolution element.
    """
    from scipy.interpolate import RegularGridInterpolator

    low, high = float(angle.min(initial=0.0)), float(angle.max(initial=0.0))
    few = min(int(np.ceil((high - low) * 2 * len(wave.opd) * wave.pixel / wave.wavelength)) + 1, 257)
    if few < 2 or few >= len(angle):
        return of_map(wave, lambda one: number(one, angle))
    some = np.linspace(low, high, few)
    found = RegularGridInterpolator((some, some), of_map(wave, lambda one: number(one, some)))
    return np.asarray(found(np.stack(np.meshgrid(angle, angle, indexing="ij"), axis=-1)))
