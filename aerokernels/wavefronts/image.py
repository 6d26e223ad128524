"""The image of a wavefront: width of its spot, light of several wavelengths, and the errors of its numbers."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ..display.quantities import Quantity
from ..inputs.wavelength import check_spectrum
from .changes import of_map
from .point_spread import PointSpread, complex_amplitude, width_at_half
from .transfer import autocorrelation, encircler, transfer_function


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
            solved[one.pixel] = encircler(transfer_function(one).frequency, angle)
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
