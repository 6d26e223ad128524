"""The wavelengths of polychromatic light, and the share of the light at each."""

from dataclasses import dataclass

import numpy as np

from ..inputs.wavelength import check_spectrum


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Light of several wavelengths.

    Attributes:
        wavelengths: Vacuum wavelengths [m], shape (n,).
        weights: Shares of the light, shape (n,), or (n, colours), a column for each colour; each sums to 1.
    """

    wavelengths: np.ndarray
    weights: np.ndarray

    @classmethod
    def of(cls, wavelengths, weights=None, scene: np.ndarray | None = None) -> "Spectrum":
        """Check and make a spectrum; for a scene with colours the weights may have a column for each.

        Raises:
            ValueError: There are no wavelengths, one is outside 0.1 to 20 um, or weights have another shape, are
                negative or all 0.
        """
        colours = scene.shape[2] if scene is not None and scene.ndim == 3 else None
        return cls(*check_spectrum(wavelengths, weights, colours))

    @property
    def mean_weights(self) -> np.ndarray:
        """Shares of the light, averaged over all colours, shape (n,)."""
        return self.weights if self.weights.ndim == 1 else self.weights.mean(axis=1)
