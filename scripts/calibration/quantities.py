"""The numbers whose errors are calibrated, each from what some rays of a pupil bring."""

import numpy as np

from aerokernels.tracing.variants.paths import Rays
from aerokernels.wavefronts.terms import PupilNumbers

# Numbers that are compared with the OPD rms, not with themselves: they may be zero.
SIGNED = ("tilt_x", "tilt_y", "focus", "astigmatism", "coma")


def zernikes(x: np.ndarray) -> np.ndarray:
    """Return six Zernike polynomials at points of the unit disc (n, 2)."""
    square = np.sum(x**2, axis=1)
    return np.stack(
        [
            np.ones(len(x)),
            2.0 * x[:, 0],
            2.0 * x[:, 1],
            np.sqrt(3.0) * (2.0 * square - 1.0),
            np.sqrt(6.0) * (x[:, 0] ** 2 - x[:, 1] ** 2),
            np.sqrt(8.0) * (3.0 * square - 2.0) * x[:, 1],
        ],
        axis=1,
    )


class Numbers:
    """Computes the numbers of rays at points of a disc."""

    def __init__(self, x: np.ndarray, radius: float, wavelength: float):
        """Take the rays' places over the radius, shape (n, 2), the radius and the wavelength [m]."""
        self.basis, self.x, self.radius, self.wavelength = zernikes(x), x, radius, wavelength
        self.pupil = PupilNumbers(x * radius, np.full(len(x), 1.0 / len(x)), wavelength)
        self.names = ("strehl", "opd_rms", "tilt_x", "tilt_y", "focus", "astigmatism", "coma", "psf", "echo", "range")

    def __call__(self, rays: Rays) -> np.ndarray:
        """Return the numbers: [m] for opd_rms, modes and range, [rad] for tilt, W for an echo of 1 W without air."""
        strehl, _, rms, tilt_x, tilt_y = self.pupil(rays)
        modes = np.linalg.lstsq(self.basis, rays.opd, rcond=None)[0]
        k = 2.0 * np.pi / self.wavelength
        angle = 0.5 * self.wavelength / (2.0 * self.radius)
        psf = abs(np.mean(np.exp(1j * k * (rays.opd - angle * self.radius * self.x[:, 0])))) ** 2
        walk = 0.9 * np.sqrt(max(np.log(max(strehl, 1e-3) / 0.03), 0.0))  # a leading edge at 3 % of the full echo
        return np.array([strehl, rms, tilt_x, tilt_y, *modes[3:], psf, strehl**2, rays.opd.mean() - walk])

    def scale(self, name: str, value: float, rms: float) -> float:
        """Return the size with which an error is compared."""
        if name in SIGNED:
            return rms / self.radius if name.startswith("tilt") else rms
        return abs(value)
