r"""Propagate light through homogeneous air by its angular spectrum: exact for components that the pixels resolve.

    A(x, z) = F^-1 [ F[A](f) exp(i z (sqrt(k^2 - K^2) - k)) ],      K = 2 pi f, k = 2 pi n / lambda

The phase k z of a plane wave along the axis is removed. The paraxial equation has -K^2 / (2 k) in place of the root
minus k (J. W. Goodman, Introduction to Fourier Optics, 3.10). The window is periodic: light that leaves it on one side
enters on the other. Evanescent waves (K > k) decay.
"""

import numpy as np

from ..inputs.arguments import checked
from ..inputs.checks import check_at_least, check_positive, warn_caller
from ..inputs.wavelength import check_wavelength


def transfer_exponent(
    shape: tuple[int, int], pixel: float, wavelength: float, ambient_index: float, paraxial: bool
) -> np.ndarray:
    """Return the exponent of each Fourier component per metre, complex, shape (rows, columns), in SciPy's order."""
    wave_number = 2.0 * np.pi * ambient_index / wavelength
    up, right = (2.0 * np.pi * np.fft.fftfreq(count, pixel) for count in shape)
    square = up[:, None] ** 2 + right**2
    if paraxial:
        return np.asarray(-0.5j * square / wave_number)
    # root - k without cancellation.
    root = np.sqrt((wave_number**2 - square).astype(np.complex128))
    return np.asarray(-1j * square / (root + wave_number))


def as_amplitude(values) -> np.ndarray:
    """Return complex or real numbers as a complex array.

    Raises:
        TypeError: They are not numbers.
    """
    try:
        return np.asarray(values, dtype=np.complex128)
    except (TypeError, ValueError, OverflowError):
        raise TypeError(
            f"the amplitude must be an array of complex or real numbers, got {type(values).__name__}"
        ) from None


@checked
def angular_spectrum(
    amplitude,
    pixel: float,
    wavelength: float,
    distance: float,
    *,
    ambient_index: float = 1.0,
    paraxial: bool = False,
) -> np.ndarray:
    """Return the complex amplitude after a distance, of the same shape, without the phase of the axial plane wave.

    Args:
        amplitude: Complex amplitude over square pixels, shape (rows, columns), axes [y, x]; one row for a
            one-dimensional problem.
        pixel: Side of a pixel [m].
        wavelength: Vacuum wavelength [m].
        distance: Distance of propagation [m]; negative propagates back.
        ambient_index: Refractive index of the air.
        paraxial: Whether to solve the paraxial equation (Fresnel) instead of Helmholtz's.

    Raises:
        TypeError: An argument is of the wrong type.
        ValueError: The amplitude is not a two-axis array of finite numbers, the wavelength is outside 0.1 to 20 um, the
            pixel or the index is not positive, or the distance is not finite.
    """
    from scipy.fft import fft2, ifft2

    amplitude = as_amplitude(amplitude)
    if amplitude.ndim != 2 or not amplitude.size or not np.isfinite(amplitude).all():
        raise ValueError(f"the amplitude must be finite and have two axes [y, x], got shape {amplitude.shape}")
    wavelength, distance = check_wavelength(wavelength), check_at_least(distance, "distance")
    pixel, ambient_index = check_positive(pixel, "pixel", "m"), check_positive(ambient_index, "ambient_index")
    exponent = transfer_exponent(amplitude.shape, pixel, wavelength, ambient_index, paraxial)
    if distance < 0.0:  # evanescent waves do not grow
        exponent = 1j * exponent.imag
    return np.asarray(ifft2(fft2(amplitude) * np.exp(distance * exponent)))


class WrappedWaveWarning(UserWarning):
    """Light leaves the window of a wave, and comes back on its other side."""


def wrapped_share(
    amplitude: np.ndarray, pixel: float, wavelength: float, distance: float, ambient_index: float
) -> float:
    """Return the share of the light that certainly leaves the periodic window over a distance [m], by either axis.

    A component of the angular spectrum with the slope t moves by the distance times t. All light starts within the lit
    part of the window: if the whole lit part, moved so far, is beyond a side, the component's light has left.

    Args:
        amplitude: Complex amplitude over square pixels, shape (rows, columns).
        pixel: Side of a pixel [m].
        wavelength: Vacuum wavelength [m].
        distance: Distance of propagation [m].
        ambient_index: Refractive index of the air.
    """
    from scipy.fft import fft2, fftfreq

    light, spectrum = np.abs(amplitude) ** 2, np.abs(fft2(amplitude)) ** 2
    worst = 0.0
    for axis in (0, 1):
        begun = np.cumsum(light.sum(axis=1 - axis))
        first, last = np.searchsorted(begun, np.array([1e-4, 1.0 - 1e-4]) * begun[-1])
        count = begun.size
        sine = fftfreq(count, pixel) * wavelength / ambient_index
        slope = sine / np.sqrt(np.maximum(1.0 - sine**2, np.finfo(np.float64).tiny))
        moved = np.where(np.abs(sine) < 1.0, slope * distance / pixel, 0.0)  # the others are evanescent
        left = (first + moved > count - 0.5) | (last + moved < -0.5)
        by_component = spectrum.sum(axis=1 - axis)
        worst = max(worst, float(by_component[left].sum() / by_component.sum()))
    return worst


def warn_of_wrapping(
    amplitude: np.ndarray, pixel: float, wavelength: float, distance: float, ambient_index: float
) -> None:
    """Warn if more than a thousandth of the light leaves the window; the arguments are those of `wrapped_share`."""
    share = wrapped_share(amplitude, pixel, wavelength, distance, ambient_index)
    if share > 1e-3:
        rows, columns = amplitude.shape
        warn_caller(
            f"over {distance:.4g} m at least {100.0 * share:.2g} % of the light leaves the window of "
            f"{columns * pixel:.4g} m x {rows * pixel:.4g} m, which is periodic, and comes back on its other side: "
            "the amplitude is not that of free space; take a wider window, or a Wave with a margin of zeros",
            WrappedWaveWarning,
        )
