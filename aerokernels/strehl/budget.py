"""The error budget of a Strehl ratio over a pupil: OPD errors of some of its rays, as errors of the ratio.

strehl_errors.py bounds the change of the ratio by a phase error. The sampling error is STANDARD_ERRORS standard errors.
"""

from dataclasses import dataclass

import numpy as np

from ..medium import IndexField
from ..rays import Pupil, RayBundle
from ..tracing import Plane
from ..tracing.budget import CAUSES, SAFETY, column_error, combine, faintly_lost, float64_rounding, opd_errors
from ..tracing.budget_rays import SUBSET
from ..tracing.pupil_air import PupilAir
from ..tracing.trace import retracer
from ..wavefront.strehl_errors import STANDARD_ERRORS, strehl_error


@dataclass(frozen=True, eq=False)
class StrehlBudget:
    """What the errors of an estimate are measured with: what was asked of it. Called when they are read.

    Attributes:
        field: The refractive index.
        pupil: The pupil.
        look: Direction in which its rays leave, unit vector of shape (3,).
        seed: Seed of the rays that are traced again.
        until: Where they stop.
        wavelength: Vacuum wavelength [m].
        air: What the pupil may lose where the known air ends.
    """

    field: IndexField
    pupil: Pupil
    look: np.ndarray
    seed: int | None
    until: Plane
    wavelength: float
    air: PupilAir

    def __call__(self, found) -> dict[str, float]:
        """The errors of an estimate's value by cause, and "total"; some rays of the pupil are traced again for them.

        Args:
            found: The StrehlEstimate.
        """
        seed = 0 if self.seed is None else self.seed
        probe = RayBundle.collimated(self.pupil, SUBSET, direction=self.look, seed=seed)
        errors = opd_errors(self.field, probe, found.plan, retracer(self.until, self.wavelength))
        spread = {
            cause: SAFETY * float(np.std(error)) if len(error) else float("nan") for cause, error in errors.items()
        }
        # Neither a column's error nor the model's is a sample of a few: they are root mean squares already.
        spread["resampling"] = float(np.hypot(spread["resampling"], SAFETY * column_error(self.field)))
        spread["refractivity"] /= SAFETY
        spread["precision"] += float64_rounding(self.field, probe)
        faint = float(np.sqrt(np.mean(faintly_lost(self.field, probe, None) ** 2)))
        spread["truncation"] = SAFETY * max(self.air.lost_rms, faint)
        of_path = combine(spread)
        causes = {cause: strehl_error(found.value, 2.0 * np.pi * of_path[cause] / self.wavelength) for cause in CAUSES}
        return combine({**causes, "sampling": STANDARD_ERRORS * found.standard_error})
