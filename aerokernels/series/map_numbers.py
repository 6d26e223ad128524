"""The numbers of a snapshot's map on some of its rays, so that an error is the number computed again."""

from dataclasses import dataclass

import numpy as np

from ..display.quantities import combine
from ..tracing.variants.causes import Variants, errors, of_a_ray
from ..tracing.variants.paths import Rays
from ..wavefront.terms import PupilNumbers, fit_tilt, remove_terms, weighted_mean

# The numbers, in order; and with the optical path difference of a ray, what has an error.
NAMES = ("strehl", "boresight_x", "boresight_y", "piston", "opd_rms", "opd_rms_with_tilt")
WRONG = (*NAMES, "error")


@dataclass(frozen=True, eq=False)
class MapNumbers:
    """Computes NAMES: Strehl ratio, tilt along both axes [rad], mean, rms without tilt and rms with it [m].

    Attributes:
        points: Coordinates of the rays across the look direction [m], shape (n, 2).
        weight: Their shares, which sum to 1, shape (n,).
        wavelength: Vacuum wavelength [m].
        remove: Terms removed before the Strehl ratio.
    """

    points: np.ndarray
    weight: np.ndarray
    wavelength: float
    remove: tuple[str, ...]

    def __call__(self, rays: Rays) -> np.ndarray:
        """Return NAMES of rays, shape (6,)."""
        strehl = PupilNumbers(self.points, self.weight, self.wavelength, self.remove)(rays)[0]
        fit = fit_tilt(rays.opd, self.points, self.weight)
        with_tilt = np.sqrt(weighted_mean(self.weight, (rays.opd - fit.piston) ** 2))
        return np.array([strehl, *fit.tilt, fit.piston, fit.residual_rms, with_tilt])

    def left(self, rays: Rays) -> np.ndarray:
        """Return the optical path differences without the removed terms [m], shape (n,)."""
        return remove_terms(rays.opd, self.remove, self.points, self.weight)


def map_errors(found: Variants | None, numbers: MapNumbers) -> dict[str, float]:
    """Return the errors of WRONG; NaN where no ray is known."""
    if found is None:
        return dict.fromkeys(WRONG, float("nan"))
    by_cause = errors(numbers, found)
    totals = [combine({cause: error[k] for cause, error in by_cause.items()})["total"] for k in range(len(NAMES))]
    return {**dict(zip(NAMES, totals, strict=True)), "error": of_a_ray(numbers.left, found)["total"]}
