"""The numbers of a pupil's wavefront from some of its rays, so that an error is the number computed again."""

from dataclasses import dataclass

import numpy as np

from ..tracing.variants.paths import Rays
from .terms import fit_tilt, mean_phasor, remove_terms, weighted_mean

# The numbers, in order.
NUMBERS = ("value", "marechal", "opd_rms", "boresight_x", "boresight_y")


@dataclass(frozen=True, eq=False)
class PupilNumbers:
    """Computes NUMBERS: Strehl ratio, Marechal's, OPD rms [m], and the beam's deflection along two axes [rad].

    Attributes:
        points: Coordinates of the rays across the pupil [m], shape (n, 2).
        weight: Their shares, shape (n,).
        wavelength: Vacuum wavelength [m].
        remove: Terms removed before the first three.
    """

    points: np.ndarray
    weight: np.ndarray
    wavelength: float
    remove: tuple[str, ...] = ("piston",)

    def __call__(self, rays: Rays) -> np.ndarray:
        """Return NUMBERS of rays, shape (5,)."""
        opd = remove_terms(rays.opd, (*self.remove, "piston"), self.points, self.weight)
        square = weighted_mean(self.weight, opd**2)
        strehl = abs(mean_phasor(opd, self.weight, self.wavelength)) ** 2
        marechal = np.exp(-((2.0 * np.pi / self.wavelength) ** 2) * square)
        tilt = fit_tilt(rays.opd, self.points, self.weight).tilt
        return np.array([strehl, marechal, np.sqrt(square), *tilt])
