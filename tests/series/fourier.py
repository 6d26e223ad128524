"""Random density fields of Fourier modes, whose line integrals are closed forms."""

from aerokernels.validation.fourier_fields import CONSTANT, WAVELENGTH, Fourier

__all__ = ["CONSTANT", "WAVELENGTH", "Fourier"]
