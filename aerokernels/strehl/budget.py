"""The errors of a pupil's Strehl ratio, OPD rms and boresight: each computed again on rays that change by cause."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..display.error_budget import ErrorBudget, combine, unknown
from ..medium import IndexField
from ..pupils import transverse_axes
from ..rays import Pupil, RayBundle
from ..tracing import Plane
from ..tracing.cuts import lost
from ..tracing.plan import TracePlan
from ..tracing.pupil.fit import fit_moments, rms_about
from ..tracing.status import reached
from ..tracing.trace import rerun
from ..tracing.variants.causes import Variants, sample_size, variants
from ..tracing.variants.spread import errors
from ..wavefront.pupil_numbers import NUMBERS, PupilNumbers

# Standard errors of a mean over 16 replicates within which it is 95 times of 100 (Student's t).
STANDARD_ERRORS = 2.13


@dataclass(eq=False)
class StrehlVariants:
    """Traces some rays of a pupil again, and finds how they change by cause, when it is asked.

    Attributes:
        field: The refractive index.
        pupil: The pupil.
        look: Direction in which the rays leave, unit vector of shape (3,).
        seed: Seed of the rays.
        until: Plane on which the rays stop.
        wavelength: Vacuum wavelength [m].
        plan: The plan of the estimate.
    """

    field: IndexField
    pupil: Pupil
    look: np.ndarray
    seed: int
    until: Plane
    wavelength: float
    plan: TracePlan

    @cached_property
    def found(self) -> Variants | None:
        """The rays and their changes; None where none arrived."""
        rays = RayBundle.collimated(self.pupil, sample_size(self.field), direction=self.look, seed=self.seed)
        run = rerun(self.until, self.wavelength)
        plan = replace(self.plan, bundle=None)
        base, status = run(self.field, rays, plan)
        good = np.flatnonzero(reached(status))
        if not len(good):
            return None
        base, some = base[good], rays.rows(good)
        beyond = lost(self.field, some, self.until, (base.position, base.direction))
        return variants(
            self.field, some, base, plan, self.until, run, weight=np.asarray(rays.weight)[good], lost=beyond
        )

    def numbers(self, remove: tuple[str, ...]) -> PupilNumbers:
        """Return what computes the numbers of these rays, without some terms."""
        assert self.found is not None
        points = (self.found.start - self.pupil.center) @ np.stack(transverse_axes(self.look), axis=1)
        return PupilNumbers(points, self.found.weight, self.wavelength, remove)


def budgets(
    found: StrehlVariants, standard_error: float, moments: np.ndarray, remove: tuple[str, ...]
) -> dict[str, ErrorBudget]:
    """Return the error budgets of an estimate's numbers, by NUMBERS.

    Args:
        found: The rays and their changes.
        standard_error: Standard error of the Strehl ratio over the replicates.
        moments: Sums of the replicates, shape (replicate_count, at least 10), see tracing/pupil/sums.py.
        remove: Terms removed from the wavefront.
    """
    units = dict(zip(NUMBERS, ("", "", "m", "rad", "rad"), strict=True))
    if found.found is None:
        return {name: unknown(unit) for name, unit in units.items()}
    by_cause = errors(found.numbers(remove), found.found)
    arrived = [row for row in moments if row[0] > 0.0]
    fits = np.array([[rms_about(row, remove), *fit_moments(row)[1]] for row in arrived])
    rms, *tilt = np.std(fits, axis=0, ddof=1) / np.sqrt(len(fits)) if len(fits) > 1 else np.full(3, np.nan)
    slope = 2.0 * (2.0 * np.pi / found.wavelength) ** 2 * float(np.mean(fits[:, 0])) if len(fits) else 0.0
    sampling = standard_error, slope * rms, rms, *tilt
    return {
        name: combine(
            {cause: float(error[k]) for cause, error in by_cause.items()}
            | {"sampling": STANDARD_ERRORS * float(sampling[k])},
            unit,
        )
        for k, (name, unit) in enumerate(units.items())
    }
