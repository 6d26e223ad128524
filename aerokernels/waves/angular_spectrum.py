r"""Light over a distance in homogeneous air, by its angular spectrum: exact for what the window's pixels can hold.

    A(x, z) = F^-1 [ F[A](f) exp(i z (sqrt(k^2 - K^2) - k)) ],      K = 2 pi f, k = 2 pi n / lambda

with the phase k z of a plane wave along the axis taken out, and for the paraxial equation -K^2 / (2 k) in place of the
root (J. W. Goodman, Introduction to Fourier Optics, 3.10). The window is periodic: what leaves it on one side comes in
on the other. Waves that do not travel (K > k) die out.
"""

import numpy as np

from ..inputs.arguments import checked
from ..inputs.checks import check_at_least, check_positive
from ..inputs.wavelength import check_wavelength


def transfer_exponent(
    shape: tuple[int, int], pixel: float, wavelength: float, ambient_index: float, paraxial: bool
) -> np.ndarray:
    """What a metre adds to the exponent of each component, complex, shape (rows, columns), frequencies as SciPy's."""
    wave_number = 2.0 * np.pi * ambient_index / wavelength
    up, right = (2.0 * np.pi * np.fft.fftfreq(count, pixel) for count in shape)
    square = up[:, None] ** 2 + right**2
    if paraxial:
        return np.asarray(-0.5j * square / wave_number)
    # The difference of the root and k, without cancellation.
    root = np.sqrt((wave_number**2 - square).astype(np.complex128))
    return np.asarray(-1j * square / (root + wave_number))


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
    """The amplitude a distance farther on, complex, of the same shape, without the phase of the axial plane wave.

    Args:
        amplitude: Complex amplitude over square pixels, shape (rows, columns), axes [y, x]; one row for a problem of
            one dimension.
        pixel: Side of a pixel [m].
        wavelength: Vacuum wavelength [m].
        distance: How far [m]; negative goes back.
        ambient_index: Index of the air.
        paraxial: Whether the paraxial equation is solved, Fresnel's, in place of Helmholtz's.

    Raises:
        TypeError: A text or the like for a number.
        ValueError: An amplitude that is no two-axis array of finite numbers, a wavelength outside 0.1 to 20 um, a pixel
            or an index that is not positive, a distance that is not finite.
    """
    from scipy.fft import fft2, ifft2

    amplitude = np.asarray(amplitude, dtype=np.complex128)
    if amplitude.ndim != 2 or not np.isfinite(amplitude).all():
        raise ValueError(f"the amplitude must be finite and have two axes [y, x], got shape {amplitude.shape}")
    wavelength, distance = check_wavelength(wavelength), check_at_least(distance, "distance")
    pixel, ambient_index = check_positive(pixel, "pixel", "m"), check_positive(ambient_index, "ambient_index")
    exponent = transfer_exponent(amplitude.shape, pixel, wavelength, ambient_index, paraxial)
    if distance < 0.0:  # evanescent waves do not grow
        exponent = 1j * exponent.imag
    return np.asarray(ifft2(fft2(amplitude) * np.exp(distance * exponent)))
