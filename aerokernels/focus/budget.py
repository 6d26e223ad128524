"""The errors of a pupil's Strehl ratio, OPD rms and boresight: the number again on rays that change by cause."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from aerokernels.tracing.tasks.sums import fit_moments, rms_about

from ..display.quantities import ErrorBudget, combine, unknown
from ..medium import IndexField
from ..pupils import transverse_axes
from ..pupils.base import Pupil
from ..rays import RayBundle
from ..tracing import Plane
from ..tracing.cuts import lost
from ..tracing.plan import TracePlan
from ..tracing.status import reached
from ..tracing.trace import rerun
from ..tracing.variants.causes import Variants, errors, sample_size, variants
from ..wavefronts.terms import NUMBERS, PupilNumbers

# Standard errors of a mean over 16 replicates within which it is 95 times of 100 (Student's t).
STANDARD_ERRORS = 2.13


@dataclass(eq=False)
class StrehlVariants:
    """Some rays of a pupil along the unit vector `look` to the plane `until`, and how they change by cause."""

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


@dataclass(eq=False)
class StrehlErrors:
    """Computes the errors of an estimate's numbers when it is called; `moments` are those of `PupilSums`."""

    rays: StrehlVariants
    standard_error: float
    moments: np.ndarray
    remove: tuple[str, ...]

    @property
    def sampling(self) -> np.ndarray:
        """Errors of NUMBERS by the number of rays, shape (5,)."""
        fits = [[rms_about(row, self.remove), *fit_moments(row)[1]] for row in self.moments if row[0] > 0.0]
        return sampling_of(self.standard_error, np.array(fits), self.rays.wavelength)

    @cached_property
    def by_cause(self) -> dict[str, np.ndarray] | None:
        """Errors of NUMBERS by every other cause, shape (5,) each; None where no ray arrived."""
        found = self.rays.found
        return None if found is None else errors(self.rays.numbers(self.remove), found)

    @property
    def model(self) -> np.ndarray:
        """Errors of NUMBERS by all other causes together, shape (5,)."""
        if self.by_cause is None:
            return np.full(len(NUMBERS), np.nan)
        return np.sqrt(np.sum(np.square(list(self.by_cause.values())), axis=0))

    def __call__(self) -> dict[str, ErrorBudget]:
        """Return the error budgets, by NUMBERS."""
        units = dict(zip(NUMBERS, ("", "", "m", "rad", "rad"), strict=True))
        if self.by_cause is None:
            return {name: unknown(unit) for name, unit in units.items()}
        causes = self.by_cause | {"sampling": self.sampling}
        return {
            name: combine({cause: float(error[k]) for cause, error in causes.items()}, unit)
            for k, (name, unit) in enumerate(units.items())
        }


def sampling_of(standard_error: float, fits: np.ndarray, wavelength: float) -> np.ndarray:
    """Return the errors of NUMBERS by the number of rays, from OPD rms [m] and tilt [rad] of each replicate, (n, 3)."""
    rms, *tilt = np.std(fits, axis=0, ddof=1) / np.sqrt(len(fits)) if len(fits) > 1 else np.full(3, np.nan)
    slope = 2.0 * (2.0 * np.pi / wavelength) ** 2 * float(np.mean(fits[:, 0])) if len(fits) else 0.0
    return STANDARD_ERRORS * np.array([standard_error, slope * rms, rms, *tilt])
