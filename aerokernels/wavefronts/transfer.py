r"""Optical transfer function of a wavefront on a square grid, and from it MTF and encircled energy.

    OTF(f) = sum_x A(x) A*(x + lambda f) / P                           the Fourier transform of the PSF; 1 at f = 0
    E(a) = p^2 sum_f OTF(f) exp(2 pi i f c) a J1(2 pi a |f|) / |f|     light within the angle a about c

A = w exp(i k OPD), frequencies f in cycles per radian, p their spacing, P the pupil's power. E is exact for the pixels.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..display.quantities import Quantity
from ..display.shown import drawn_on, shown
from ..inputs.arguments import Numbers, checked
from ..inputs.checks import check_at_least
from ..pupils import Disc
from .changes import of_map
from .point_spread import complex_amplitude, intensities, width_at_half

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@shown
@dataclass(frozen=True, eq=False)
class Transfer:
    """Transfer function on a grid of spatial frequencies.

    Attributes:
        value: OTF (complex) or MTF (real), shape (n, n), axes [y, x]; 1 at frequency 0.
        frequency: Frequencies of rows and columns [cycles / rad], shape (n,), ascending about 0.
        perfect: MTF of the same pupil without aberrations, shape (n, n).
        errors: Function that returns the error of each value, shape (n, n); `error` calls it.
    """

    value: np.ndarray
    frequency: np.ndarray
    perfect: np.ndarray
    errors: Callable[[], np.ndarray] | None = field(default=None, repr=False)

    @cached_property
    def error(self) -> np.ndarray:
        """Error of each value, shape (n, n); NaN if it is not known. Computed when first read."""
        return np.full(np.shape(self.value), np.nan) if self.errors is None else self.errors()

    @checked
    def along(self, angle: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Return frequencies [cycles / rad] and values on the line at this angle from x toward y [rad], both (n,)."""
        from scipy.interpolate import RegularGridInterpolator

        check_at_least(angle, "angle")
        middle = len(self.frequency) // 2
        frequency = self.frequency[middle:]
        line = np.stack([frequency * np.sin(angle), frequency * np.cos(angle)], axis=1)
        return frequency, RegularGridInterpolator((self.frequency, self.frequency), self.value)(line)

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw the function along both axes, beside the perfect one, on matplotlib axes; return the axes."""
        axes = drawn_on(axes)
        for name, angle in (("x", 0.0), ("y", 0.5 * np.pi)):
            frequency, value = self.along(angle)
            axes.plot(frequency * 1e-3, np.abs(value), label=f"along {name}")
        middle = len(self.frequency) // 2
        axes.plot(self.frequency[middle:] * 1e-3, self.perfect[middle, middle:], "k:", label="perfect")
        axes.set(xlabel="spatial frequency [cycles / mrad]", ylabel="MTF", ylim=(0.0, 1.05))
        axes.legend()
        return axes


@shown
@dataclass(frozen=True, eq=False)
class EncircledEnergy:
    """Share of the light within an angle about a point of the image.

    Attributes:
        angle: Radius of the circle [rad], any shape.
        energy: Share of the light that the pupil transmits, of the same shape.
        center: The point [rad], shape (2,).
        errors: Function that returns the error of each share, of the same shape; `error` calls it.
    """

    angle: np.ndarray
    energy: np.ndarray
    center: np.ndarray
    errors: Callable[[], np.ndarray] | None = field(default=None, repr=False)

    @cached_property
    def error(self) -> np.ndarray:
        """Error of each share, of their shape; NaN if it is not known. Computed when first read."""
        return np.full(np.shape(self.energy), np.nan) if self.errors is None else self.errors()

    @checked
    def radius(self, share: float) -> float:
        """Return the angle that encircles this share of the light [rad], interpolated; NaN beyond the given angles."""
        order = np.argsort(self.angle, axis=None)
        return float(np.interp(share, self.energy.ravel()[order], self.angle.ravel()[order], left=np.nan, right=np.nan))

    def __array__(self, dtype=None, copy=None) -> np.ndarray:
        """The shares."""
        return np.array(self.energy, dtype=dtype)

    def __float__(self) -> float:
        """The share of a single angle."""
        return float(self.energy)

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw the encircled energy on matplotlib axes; return the axes."""
        axes = drawn_on(axes)
        axes.plot(np.ravel(self.angle) * 1e6, np.ravel(self.energy))
        axes.set(xlabel="angle [urad]", ylabel="encircled energy", ylim=(0.0, 1.05))
        return axes


def autocorrelation(wave: np.ndarray, other: np.ndarray | None = None) -> np.ndarray:
    """Return sum_x a(x) b*(x + m) of maps (n, n) for all shifts m, shape (2 n - 1, 2 n - 1), m = 0 in the middle."""
    from scipy.fft import fft2, fftshift, ifft2, next_fast_len

    rows, columns = wave.shape
    size = [next_fast_len(2 * count - 1) for count in (rows, columns)]
    spectrum = fft2(wave, size)
    second = spectrum if other is None else fft2(other, size)
    whole = fftshift(np.conj(ifft2(np.conj(spectrum) * second)))
    top, left = (n // 2 - (count - 1) for n, count in zip(size, (rows, columns), strict=True))
    return whole[top : top + 2 * rows - 1, left : left + 2 * columns - 1]


def otf(wave: Any) -> Transfer:
    """Return the complex optical transfer function."""
    value = _transfer(wave, wave.pixel)
    perfect = np.abs(autocorrelation(np.array(wave.weight))) / wave.power
    middle = len(value) // 2
    perfect[middle, middle] = 1.0
    frequency = wave.pixel / wave.wavelength * np.arange(-middle, middle + 1)
    return Transfer(value, frequency, perfect, partial(transfer_errors, wave, False))


def mtf(wave: Any) -> Transfer:
    """Return the modulation transfer function, the magnitude of the OTF."""
    found = otf(wave)
    return replace(found, value=np.abs(found.value), errors=partial(transfer_errors, wave, True))


@checked
def encircled_energy(wave: Any, /, angle: Numbers | None = None, *, center: Numbers | None = None) -> EncircledEnergy:
    """Return the share of the light within an angle about a point of the image, exact for the pixels of the map.

    All light counts as being within wavelength / (2 pixel) along either axis, the range that the pixels can represent.

    Args:
        wave: The wavefront.
        angle: Angles [rad], any shape; None takes 65 up to eight times wavelength / width.
        center: The point [rad], two numbers along x and y; None takes the centroid.

    Raises:
        ValueError: An angle is negative or not finite, or `center` is not two finite angles.
    """
    width = len(wave.opd) * wave.pixel
    angle = np.linspace(0.0, 8.0 * wave.wavelength / width, 65) if angle is None else np.asarray(angle, dtype=float)
    if not (np.isfinite(angle) & (angle >= 0.0)).all():
        raise ValueError(f"angle must be finite and at least 0 rad, got {angle!r}")
    point = wave.centroid if center is None else np.asarray(center, dtype=float)
    if center is None and not np.isfinite(point).all():
        raise ValueError("no pixel has a neighbour, so there is no centroid: give `center` or more pixels")
    if point.shape != (2,) or not np.isfinite(point).all():
        raise ValueError(f"center must be two angles along x and y [rad], got {center!r}")
    errors, transfer = partial(encircled_errors, wave, angle, None if center is None else point), otf(wave)
    return EncircledEnergy(angle, encircler(transfer.frequency, angle)(transfer.value, point), point, errors)


def encircler(frequency: np.ndarray, angle: np.ndarray) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return the function that returns shares of the light within angles [rad] of a transfer function about a point."""
    from scipy.special import j1

    if len(frequency) < 2:
        raise ValueError("a wavefront of one pixel has no encircled energy: give a greater pixel_count")
    fx, fy = frequency[None, :], frequency[:, None]
    spacing = float(frequency[1] - frequency[0])
    index = np.rint(frequency / spacing).astype(np.int64)
    squared, place = np.unique((index[:, None] ** 2 + index[None, :] ** 2).ravel(), return_inverse=True)
    radial = spacing * np.sqrt(squared[1:])
    flat = np.abs(np.ravel(angle))
    # The pixels' PSF has the period wavelength / pixel: one period, a square about the point, holds all the light.
    half = 0.5 / spacing
    inside = np.minimum(flat, half)
    kernel = np.array([a * j1(2.0 * np.pi * a * radial) / radial for a in inside]).reshape(len(inside), len(radial))

    def shares(value: np.ndarray, center: np.ndarray) -> np.ndarray:
        # They are real, so only the even part of the transfer function counts, which is real.
        even = (value * np.exp(2j * np.pi * (fx * center[0] + fy * center[1]))).real
        summed = np.bincount(place.ravel(), even.ravel())
        energy = spacing**2 * (np.array([row @ summed[1:] for row in kernel]) + np.pi * inside**2 * summed[0])
        for row in np.flatnonzero(flat > half):
            energy[row] = 1.0 - _in_corners(even, half, flat[row])
        return np.asarray(energy.reshape(np.shape(angle)))

    return shares


def _in_corners(even: np.ndarray, half: float, angle: float) -> float:
    """Return the light of a square period, half width `half`, outside the circle of an angle [rad] about its middle."""
    from scipy.fft import fftshift, ifft2, ifftshift

    if angle >= np.sqrt(2.0) * half:
        return 0.0
    more = (len(even) + 1) // 2  # an odd number of angles divides the period evenly
    light = fftshift(ifft2(ifftshift(np.pad(even, more))).real)
    edges = half * np.linspace(-1.0, 1.0, len(light) + 1)
    return float((light * (1.0 - Disc(angle).coverage(edges, edges))).sum())


def _spot(wave: Any) -> tuple[np.ndarray, float, float, float] | None:
    """Return middle (y, x) and half width of a window about the spot, the spot's width and its error [rad].

    A coarse PSF over all angles shows where the peak is, and how far from it other places come near half of the peak.
    """
    resolution, padding = wave.wavelength / (len(wave.opd) * wave.pixel), 4
    coarse = wave.psf(padding=padding)
    middle = coarse.angle[np.array(np.unravel_index(int(np.argmax(coarse.intensity)), coarse.intensity.shape))]
    bright = coarse.angle[np.argwhere(coarse.intensity > 0.4 * coarse.peak)]  # may be half of the true peak
    reach = float(np.abs(bright - middle).max()) + resolution / padding
    upright, half_width = _turned(wave, middle), resolution
    while half_width < reach:
        half_width *= 2.0
    for _ in range(8):
        count = min(int(128.0 * half_width / resolution), 1024)
        spread = upright.psf(np.linspace(-half_width, half_width, count + 1))
        width, error = width_at_half(spread.angle, spread.intensity)
        if np.isfinite(width):
            return middle, half_width, width, error
        half_width *= 2.0
    return None


def _turned(wave: Any, middle: np.ndarray) -> Any:
    """Return a wavefront whose image at the angles `middle` (y, x) is moved to 0."""
    row, column = (float(angle) for angle in middle)
    return replace(wave, opd=wave.opd - column * wave.coordinate[None, :] - row * wave.coordinate[:, None])


def transfer_errors(wave: Any, of_magnitude: bool) -> np.ndarray:
    """Return the errors of the optical transfer function, or of its magnitude, shape (2 n - 1, 2 n - 1)."""

    def number(one: Any) -> np.ndarray:
        value = _transfer(one, wave.pixel)
        return np.abs(value)[None] if of_magnitude else np.stack([value.real, value.imag])

    return np.asarray(np.hypot(np.linalg.norm(of_map(wave, number), axis=0), _coincident(wave)))


def _coincident(wave: Any) -> np.ndarray:
    """Return how much more light edges along rows and columns have in common where they lie on one another."""
    weight = np.asarray(wave.weight)
    spread = np.sqrt(np.maximum(np.asarray(wave.intensity) - weight**2, 0.0))
    alike = [np.abs(np.roll(weight, step, axis) - weight) < 1e-6 for axis in (0, 1) for step in (1, -1)]
    common = autocorrelation(np.where(np.any(alike, axis=0), spread, 0.0)).real / wave.power
    common[len(common) // 2, len(common) // 2] = 0.0
    return np.asarray(common)


def _transfer(wave: Any, pixel: float) -> np.ndarray:
    """Return the transfer function at the frequencies of pixels of a side [m], a multiple of the wavefront's."""
    every = round(pixel / wave.pixel)
    value = autocorrelation(complex_amplitude(wave.opd, wave.weight, wave.wavelength))
    value = value[every - 1 :: every, every - 1 :: every] / wave.power
    value[len(value) // 2, len(value) // 2] = 1.0
    return np.asarray(value)


def encircled_errors(wave: Any, angle: np.ndarray, center: np.ndarray | None) -> np.ndarray:
    """Return the errors of shares of the light within angles [rad] of a point [rad] or the centroid, of their shape."""
    solved: dict[float, Callable] = {}

    def number(one: Any) -> np.ndarray:
        if one.pixel not in solved:
            solved[one.pixel] = encircler(otf(one).frequency, angle)
        return np.asarray(solved[one.pixel](_transfer(one, one.pixel), one.centroid if center is None else center))

    return np.minimum(of_map(wave, number), 1.0)


def fwhm(wave: Any) -> float:
    """Full width at half maximum of the point spread function [rad]: see `PointSpread.fwhm`.

    It counts all area above half of the peak, including spots apart from the one that holds the peak. NaN if all
    windows are too narrow for it.
    """
    spot = _spot(wave)
    return float("nan") if spot is None else spot[2]


def image_quantities(wave: Any) -> dict[str, Quantity]:
    """Return "centroid_x", "centroid_y" and "fwhm" [rad] of the image with errors as in `quantities`."""
    (x, y), errors, spot = wave.centroid, of_map(wave, lambda one: one.centroid), _spot(wave)
    width, error = float("nan"), float("nan")
    if spot is not None:
        middle, half_width, width, sampling = spot
        count = int(32.0 * half_width * len(wave.opd) * wave.pixel / wave.wavelength) | 1
        angle = np.linspace(-half_width, half_width, count)
        changed = of_map(wave, lambda one: width_at_half(angle, intensities(_turned(one, middle), angle))[0])
        error = float(np.hypot(float(changed), sampling))
    return {
        "centroid_x": Quantity(float(x), float(errors[0]), "rad"),
        "centroid_y": Quantity(float(y), float(errors[1]), "rad"),
        "fwhm": Quantity(width, error, "rad"),
    }
