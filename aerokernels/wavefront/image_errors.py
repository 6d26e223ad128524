"""Errors of a wavefront's image: its arrays computed again on changed maps and on finer pixels (changes.py)."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from .changes import of_map
from .half_maximum import width_at_half
from .modes import centroid_weights
from .point_spread import complex_amplitude
from .spot_width import spot_window
from .transfer import autocorrelation, encircler, sensitivity, transfer_function

# Angles per resolution element at which errors of intensities are computed, and most angles along a side.
ANGLES, MOST_ANGLES = 2, 257
# Greatest difference of the amplitudes of neighbours on an edge along rows or columns.
ALIKE = 1e-6
# Samples per resolution element by which changes of a spot's width are found.
SAMPLES = 16


def spread_errors(wave: Any, angle: np.ndarray, number: Callable[[Any, np.ndarray], np.ndarray]) -> np.ndarray:
    """Return the errors of intensities at angles of rows and columns [rad] (m,), shape (m, m).

    Args:
        wave: The wavefront.
        angle: The angles.
        number: Returns the intensities of a wavefront at angles. Where there are many, errors are interpolated between
            fewer.
    """
    from scipy.interpolate import RegularGridInterpolator

    low, high = float(angle.min(initial=0.0)), float(angle.max(initial=0.0))
    few = int(np.ceil((high - low) * ANGLES * len(wave.opd) * wave.pixel / wave.wavelength)) + 1
    few = min(few, MOST_ANGLES)
    if few < 2 or few >= len(angle):
        return of_map(wave, lambda one: number(one, angle))
    some = np.linspace(low, high, few)
    found = RegularGridInterpolator((some, some), of_map(wave, lambda one: number(one, some)))
    return np.asarray(found(np.stack(np.meshgrid(angle, angle, indexing="ij"), axis=-1)))


def intensities(wave: Any, angle: np.ndarray) -> np.ndarray:
    """Return the point spread function of a wavefront at angles of rows and columns [rad] (m,), shape (m, m)."""
    kernel = np.exp(-2j * np.pi / wave.wavelength * np.outer(angle, wave.coordinate))
    amplitude = kernel @ complex_amplitude(wave.opd, wave.weight, wave.wavelength) @ kernel.T
    return np.asarray(np.abs(amplitude) ** 2 / wave.weight.sum() ** 2)


def transfer_errors(wave: Any, of_magnitude: bool) -> np.ndarray:
    """Return the errors of the optical transfer function, or of its magnitude, shape (2 n - 1, 2 n - 1)."""

    def number(one: Any) -> np.ndarray:
        value = _transfer(one, wave.pixel)
        return np.abs(value)[None] if of_magnitude else np.stack([value.real, value.imag])

    return np.asarray(np.hypot(np.linalg.norm(of_map(wave, number), axis=0), _coincident(wave)))


def _coincident(wave: Any) -> np.ndarray:
    """Return how much more light edges along rows and columns have in common where they lie on one another.

    The mean product of two pixels' amplitudes is that of their means and at most that of their spreads more. Edges
    askew to the pixels have parts of all sizes in common: that cancels.
    """
    weight = np.asarray(wave.weight)
    rest = np.sqrt(np.maximum(np.asarray(wave.intensity) - weight**2, 0.0))
    alike = [np.abs(np.roll(weight, step, axis) - weight) < ALIKE for axis in (0, 1) for step in (1, -1)]
    common = autocorrelation(np.where(np.any(alike, axis=0), rest, 0.0)).real / wave.power
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
    solved: dict[float, tuple[Callable, np.ndarray]] = {}

    def number(one: Any) -> np.ndarray:
        if one.pixel not in solved:
            solved[one.pixel] = encircler(transfer_function(one).frequency, angle), centroid_weights(one)
        shares, weights = solved[one.pixel]
        return np.asarray(shares(_transfer(one, one.pixel), _centroid(one, weights) if center is None else center))

    return np.minimum(of_map(wave, number), 1.0)


def centroid_errors(wave: Any) -> np.ndarray:
    """Return the errors of the centroid along x and y [rad], shape (2,)."""
    solved: dict[float, np.ndarray] = {}

    def number(one: Any) -> np.ndarray:
        if one.pixel not in solved:
            solved[one.pixel] = centroid_weights(one)
        return _centroid(one, solved[one.pixel])

    return of_map(wave, number)


def _centroid(wave: Any, weights: np.ndarray) -> np.ndarray:
    return np.asarray(np.sum(weights[:, wave.lit] * wave.opd[wave.lit], axis=1))


def width_error(wave: Any) -> float:
    """Return the error of the full width at half maximum [rad]; NaN if it is not known."""
    if (window := spot_window(wave)) is None:
        return float("nan")
    middle, half_width = window
    count = int(2.0 * SAMPLES * half_width * len(wave.opd) * wave.pixel / wave.wavelength) | 1
    angle = np.linspace(-half_width, half_width, count)

    def number(one: Any) -> float:
        tilted = one.opd - middle[1] * one.coordinate[None, :] - middle[0] * one.coordinate[:, None]
        return width_at_half(angle, intensities(replace(one, opd=tilted), angle))[0]

    return float(of_map(wave, number))


def sensitivity_error(wave: Any, fried: float) -> float:
    """Return the error of PSSn; `fried` is the atmosphere's r0 [m].

    The change by linear interpolation between the frequencies represents the error of the cubic one.
    """
    transfer = transfer_function(wave)
    number, linear = (sensitivity(transfer, wave.wavelength, fried, cubic) for cubic in (True, False))
    solved = {wave.pixel: number}

    def of(one: Any) -> float:
        if one.pixel not in solved:
            perfect = np.abs(_transfer(replace(one, opd=0.0 * one.opd), wave.pixel))
            solved[one.pixel] = sensitivity(replace(transfer, perfect=perfect), wave.wavelength, fried)
        return solved[one.pixel](_transfer(one, wave.pixel))

    return float(np.hypot(of_map(wave, of), linear(transfer.value) - number(transfer.value)))
