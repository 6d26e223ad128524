r"""Optical transfer function of a wavefront on a square grid, and from it MTF and encircled energy.

    OTF(f) = sum_x A(x) A*(x + lambda f) / P                           the Fourier transform of the PSF; 1 at f = 0
    E(a) = p^2 sum_f OTF(f) exp(2 pi i f c) a J1(2 pi a |f|) / |f|     light within the angle a about c

A = w exp(i k OPD), frequencies f in cycles per radian, p their spacing, P the pupil's power. E is exact for the pixels.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ..display.shown import drawn_on, shown
from ..inputs.arguments import checked
from ..inputs.checks import check_at_least
from ..pupils import Disc
from .point_spread import complex_amplitude


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

    def plot(self, axes=None):
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

    def plot(self, axes=None):
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


def transfer_function(wavefront: Any) -> Transfer:
    """Return the optical transfer function of a wavefront."""
    wave = complex_amplitude(wavefront.opd, wavefront.weight, wavefront.wavelength)
    value = autocorrelation(wave) / wavefront.power
    perfect = np.abs(autocorrelation(np.array(wavefront.weight))) / wavefront.power
    middle = len(wave) - 1
    value[middle, middle] = perfect[middle, middle] = 1.0
    frequency = wavefront.pixel / wavefront.wavelength * np.arange(-middle, middle + 1)
    return Transfer(value, frequency, perfect)


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
