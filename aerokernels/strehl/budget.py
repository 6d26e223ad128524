"""Compute the error budget of a Strehl ratio over a pupil, from the OPD errors of some of its rays.

strehl_errors.py bounds the change of the ratio by a phase error. The sampling error is STANDARD_ERRORS standard errors.
"""

from dataclasses import dataclass

import numpy as np

from ..medium import IndexField
from ..rays import Pupil, RayBundle
from ..tracing import Plane
from ..tracing.error_budget.budget import (
    CAUSES,
    SAFETY,
    column_error,
    combine,
    float64_rounding,
    opd_errors,
)
from ..tracing.error_budget.grid_error import spread as grid_spread
from ..tracing.error_budget.rays import SUBSET
from ..tracing.pupil.air import PupilAir
from ..tracing.trace import retracer
from ..wavefront.strehl_errors import STANDARD_ERRORS, strehl_error


@dataclass(eq=False)
class StrehlBudget:
    """Compute the error budget of a StrehlEstimate when its `error` is read.

    Attributes:
        field: The refractive index.
        pupil: The pupil.
        look: Direction in which the rays leave, unit vector of shape (3,).
        seed: Seed of the rays that are traced again.
        until: Plane on which the rays stop.
        wavelength: Vacuum wavelength [m].
        air: What the pupil's rays miss of the flow.
    """

    field: IndexField
    pupil: Pupil
    look: np.ndarray
    seed: int | None
    until: Plane
    wavelength: float
    air: PupilAir

    def __call__(self, found) -> dict[str, float]:
        """Trace some rays of the pupil again, and return the errors of an estimate's value by cause, and "total".

        Args:
            found: The StrehlEstimate.
        """
        seed = 0 if self.seed is None else self.seed
        probe = RayBundle.collimated(self.pupil, SUBSET, direction=self.look, seed=seed)
        errors = opd_errors(self.field, probe, found.plan, retracer(self.until, self.wavelength))
        omitted = SAFETY * grid_spread(errors.pop("omitted"))
        spread = {
            cause: SAFETY * float(np.std(error)) if len(error) else float("nan") for cause, error in errors.items()
        }
        spread["interpolation"] = float(np.maximum(spread["interpolation"], omitted))
        # The column's and the refractivity model's errors are root mean squares, not samples of a few rays.
        spread["resampling"] = float(np.hypot(spread["resampling"], SAFETY * column_error(self.field)))
        spread["refractivity"] /= SAFETY
        spread["precision"] += float64_rounding(self.field, probe)
        spread["truncation"] = self.air.lost_rms
        of_path = combine(spread)
        causes = {cause: strehl_error(found.value, 2.0 * np.pi * of_path[cause] / self.wavelength) for cause in CAUSES}
        return combine({**causes, "sampling": STANDARD_ERRORS * found.standard_error})
