"""Estimate the Strehl ratio of a pupil over millions of rays that are traced and summed on the device."""

import threading
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Unpack

import numpy as np

from aerokernels.inputs.checks import warn_caller
from aerokernels.inputs.kinds import wrong_kind
from aerokernels.tracing.tasks.sums import fit_moments, fit_terms

from ..display.quantities import ErrorBudget, combine, unknown
from ..inputs.arguments import Numbers, checked
from ..inputs.checks import check_count
from ..medium import IndexField
from ..process.clock import clocked, stage
from ..process.threads import in_turn
from ..pupils import transverse_axes
from ..pupils.base import Pupil, as_unit_vector
from ..rays import RayBundle
from ..tracing import Plane
from ..tracing.cuts import lost
from ..tracing.engines import engine_of
from ..tracing.launch import report_rejected
from ..tracing.plan import TraceOptions, TracePlan, complete
from ..tracing.pupil.job import REPLICATES, PupilJob, PupilRequest
from ..tracing.stop import reached
from ..wavefronts.terms import NUMBERS, PupilNumbers, check_terms
from .ratio import StrehlEstimate, combined, met_nothing

if TYPE_CHECKING:
    from ..tracing.variants.causes import Variants


@checked
def estimate_strehl(
    field: IndexField,
    pupil: Pupil,
    *,
    wavelength: float | None = None,
    ray_count: int = 1_000_000,
    tolerance: float = 1e-3,
    remove: str | Iterable[str] = ("piston",),
    backend: str = "auto",
    device: str | None = None,
    precision: str = "float32",
    method: str = "auto",
    step: float | None = None,
    max_steps: int | None = None,
    direction: Numbers | None = None,
    seed: int = 0,
    symmetry: str | bool = "auto",
    bundle: str = "auto",
    allow_truncation: bool = False,
) -> StrehlEstimate:
    """Estimate the Strehl ratio of a plane wave seen through a field by a pupil.

    Rays leave the pupil along its normal (or `direction`) and stop on a plane normal to that direction, beyond the
    field's box. Light is reversible: the wavefront is that of light from a distant point in that direction.

    Args:
        field: The refractive index.
        pupil: The pupil; it looks along its normal.
        wavelength: Vacuum wavelength [m]; None takes the field's own, or 905 nm if it has none.
        ray_count: Rays over the pupil, in 16 replicates. If the wavefront is symmetric or smooth (see symmetry and
            bundle) fewer are traced, for at least the same accuracy or one of 1e-5.
        tolerance: Requested OPD error [waves].
        remove: Terms removed from the wavefront: "piston", "tilt", "focus".
        backend: See `trace`; likewise device, precision, method, step and max_steps.
        device: Device of the backend.
        precision: "float32" or "float64".
        method: Tracing method.
        step: Step of method "fixed" [m].
        max_steps: Number of steps after which a ray fails.
        direction: Look direction, if not along the pupil's normal.
        seed: Seed of the scrambling.
        symmetry: "auto" uses radial quadrature instead of the disc if field, pupil and rays are symmetric about the z
            axis; "off" or False never does; True raises ValueError for a set-up that is not symmetric.
        bundle: "auto" traces as many rays as the wavefront needs for an error of 1e-5 (three standard errors), at the
            points of shifted lattices, if those are fewer: see tracing/pupil/quadrature.py. "off" traces
            `ray_count`.
        allow_truncation: Whether more than a thousandth of the pupil may look through disturbed air that was cut off
            (see cuts.py), whose effect is error["truncation"], and more than half of it past the field's box. A warning
            is issued then, and wherever more than a hundredth of the pupil looks past the box.

    Raises:
        TypeError: `field` or `pupil` of the wrong kind.
        ValueError: A name or number that makes no sense; another wavelength than the field's; no ray that meets the
            field, or that arrives; symmetry=True without symmetry; a truncated view without `allow_truncation`.
    """
    options = {name: value for name, value in locals().items() if name not in ("field", "pupil", "seed")}
    with clocked() as seconds:
        estimate = prepare_strehl(field, pupil, **options)(seed)
    return replace(estimate, seconds=seconds)


def prepare_strehl(field: IndexField, pupil: Pupil, **options) -> "PreparedStrehl":
    """Plan, upload and compile the estimate of a pupil's Strehl ratio once, to run it repeatedly.

    Args:
        field: The refractive index.
        pupil: The pupil; it looks along its normal.
        options: Those of `estimate_strehl`, without the seed.

    Raises:
        TypeError: As for `estimate_strehl`, or an unknown option.
        ValueError: As for `estimate_strehl`.
    """
    with clocked() as seconds:
        prepared = PreparedStrehl(field, pupil, **options)
        prepared.job.air.warn()
        prepared.plan = prepared.job.planned(prepared.job.run)  # uploads and compiles
    prepared.seconds = seconds
    return prepared


@checked
class PreparedStrehl:
    """The result of `prepare_strehl`: a call with a seed returns a StrehlEstimate.

    The field is on the device and the kernels are compiled; a call launches, sums and returns. Threads may share it:
    their calls run one at a time, because they use the same buffers. Unpickling prepares it again.

    Attributes:
        plan: What was chosen, skipped and why.
        seconds: Wall time of the preparation by stage: see STAGES in clock.py.
    """

    def __init__(
        self,
        field: IndexField,
        pupil: Pupil,
        *,
        wavelength: float | None = None,
        ray_count: int = 1_000_000,
        remove: str | Iterable[str] = ("piston",),
        direction=None,
        symmetry: str | bool = "auto",
        bundle: str = "auto",
        **options: Unpack[TraceOptions],
    ):
        """Check the arguments and plan."""
        if not isinstance(field, IndexField):
            raise wrong_kind(field, "field", "an IndexField")
        if not isinstance(pupil, Pupil):
            raise wrong_kind(pupil, "pupil", "a Disc, Annulus, Rectangle, Polygon or Mask")
        options = complete(options)
        self.field, self.pupil, self.options = field, pupil, options
        self.wavelength, self.asked_wavelength = field.wavelength_for(wavelength), wavelength
        self.request = PupilRequest(
            pupil=pupil,
            look=pupil.normal if direction is None else as_unit_vector(direction, "direction"),
            remove=check_terms(remove),
            ray_count=int(check_count(ray_count, "ray_count", REPLICATES)),
            symmetry=symmetry,
            bundle=bundle,
            choices={name: value for name, value in options.items() if name != "allow_truncation"},
        )
        self.seconds: dict[str, float] = {}
        self._turn = threading.Lock()  # held during a call, because calls share the buffers of the job
        self._make_job(None)

    def __reduce__(self):
        """What it was made of: what is on a device stays there."""
        request = self.request
        options = {name: getattr(request, name) for name in ("ray_count", "remove", "symmetry", "bundle")}
        options |= {"wavelength": self.asked_wavelength, "direction": request.look, **self.options}
        return partial(prepare_strehl, **options), (self.field, self.pupil)

    def __repr__(self) -> str:
        """Return ray count, pupil, wavelength and backend as text."""
        pupil, backend = type(self.pupil).__name__, self.plan.backend
        return (
            f"PreparedStrehl of {self.request.ray_count:,} rays, {pupil}, {self.wavelength * 1e9:.6g} nm, by {backend}"
        )

    def _make_job(self, like: PupilJob | None) -> None:
        with stage("plan"):
            self.job = self.request.job(self.field, self.wavelength, like)
        self.job.air.check(self.options["allow_truncation"])
        self.plan = self.job.plan

    def with_field(self, field: IndexField) -> "PreparedStrehl":
        """Prepare the same pupil for other values of the field, such as another instant of a flow.

        Kernels are reused. The numbers of samples and of rays chosen for this field are checked for the other one, and
        searched for again only if they do not suffice there. The rays may therefore differ from those of
        `prepare_strehl`, within the same errors.

        Raises:
            TypeError: `field` is no IndexField.
            ValueError: As for `estimate_strehl`.
        """
        if not isinstance(field, IndexField):
            raise wrong_kind(field, "field", "an IndexField")
        other = object.__new__(PreparedStrehl)  # a copy without preparing again
        vars(other).update(vars(self))
        other._turn = threading.Lock()
        with clocked() as seconds:
            other.field, other.wavelength = field, field.wavelength_for(self.asked_wavelength)
            other._make_job(self.job)
            other.plan = other.job.planned(other.job.run)  # uploads
        other.seconds = seconds
        return other

    def for_fields(self, fields: Iterable[IndexField], seed: int = 0) -> Iterator[StrehlEstimate]:
        """Return the estimates for many other values of the field, in order: `with_field(field)(seed)`.

        On a processor two fields are in work at a time: one is planned while the rays of the other are traced. The wall
        times of their stages then include the time that they waited for each other. Fields are taken when they are
        needed, at most two ahead.

        Raises:
            TypeError: One of the fields is no IndexField.
            ValueError: As for `estimate_strehl`.
        """
        plan = self.job.planned(self.job.run)  # prepares what all of them share
        overlaps = plan.backend != "reference" and not engine_of(plan.backend, plan.device).is_gpu
        return in_turn(lambda field: self.with_field(field)(seed), fields, 2 if overlaps else 1)

    @checked
    def __call__(self, seed: int = 0) -> StrehlEstimate:
        """Launch the points of a seed, trace and sum them.

        Raises:
            ValueError: No ray arrived beyond the field.
        """
        with self._turn, clocked() as seconds:
            return self._estimate(seed, seconds)

    def varied(self, plan: TracePlan, seed: int = 0) -> "StrehlVariants":
        """Return some rays of the pupil that are traced by a plan, and how they change by each cause of an error."""
        return StrehlVariants(
            self.field, self.pupil, self.request.look, seed, self.job.task.until, self.wavelength, plan
        )

    def _estimate(self, seed: int, seconds: dict[str, float]) -> StrehlEstimate:
        job, wavelength, remove = self.job, self.wavelength, self.request.remove
        run, why = job.run, []
        sums = run(seed)
        traced, evaluations = run.task.per_replicate * REPLICATES, sums.evaluation_count
        for count in job.finer_sizes:
            settled = job.settled(run)
            if sums.standard_error <= settled:
                break
            run = job.finer(count)
            sums = run(seed)
            traced += count * REPLICATES
            evaluations += sums.evaluation_count
            points = "radial quadrature" if run.task.is_radial else "lattice"
            finer = f"one of {REPLICATES} x {count}" if run.task.is_radial else "as many rays as requested"
            why.append(f"standard error of the {points} above {settled:g}, as at an edge: {finer}")
        plan = job.planned(run, *why)
        if sums.rejected_count:
            plan = report_rejected(plan, sums.rejected_count, sums.ray_count, sums.greatest_error, wavelength)
        mean, tilt, rms, _ = fit_moments(sums.total)
        estimate = combined(sums.total, sums.phasors, wavelength, remove)
        if met_nothing(self.field, max(abs(mean), rms), wavelength, self.options["tolerance"]):
            warn_caller(
                "all rays of the pupil pass through undisturbed air only, although the field is disturbed elsewhere: "
                "the Strehl ratio is 1; check the units (metres are expected), and the pupil's direction and position"
            )

        varied = self.varied(plan, seed)
        return StrehlEstimate(
            ray_count=job.quadrature.per_replicate * REPLICATES,
            traced_ray_count=traced,
            # The weights of a lattice add up to its number of rays within 3e-7 only.
            blocked=max(0.0, 1.0 - float(np.add.reduce(sums.moments[:, 0])) / sums.ray_count),
            plan=plan,
            varied=varied,
            budgets=StrehlErrors(varied, sums.standard_error, sums.moments, remove),
            seconds=seconds,
            standard_error=sums.standard_error,
            evaluation_count=evaluations,
            boresight=tilt,
            **estimate,
        )


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
    def found(self) -> "Variants | None":
        """The rays and their changes; None where none arrived."""
        from ..tracing.variants.causes import brought, sample_size, variants

        rays = RayBundle.collimated(self.pupil, sample_size(self.field), direction=self.look, seed=self.seed)
        plan = replace(self.plan, bundle=None)
        base, status = brought(self.field, rays, plan, self.until, self.wavelength)
        good = np.flatnonzero(reached(status))
        if not len(good):
            return None
        base, some = base[good], rays.rows(good)
        beyond = lost(self.field, some, self.until, (base.position, base.direction))
        return variants(
            self.field, some, base, plan, self.until, self.wavelength, weight=np.asarray(rays.weight)[good], lost=beyond
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
        fits = [[fit_terms(row, self.remove)[1], *fit_moments(row)[1]] for row in self.moments if row[0] > 0.0]
        return sampling_of(self.standard_error, np.array(fits), self.rays.wavelength)

    @cached_property
    def by_cause(self) -> dict[str, np.ndarray] | None:
        """Errors of NUMBERS by every other cause, shape (5,) each; None where no ray arrived."""
        from ..tracing.variants.causes import errors

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
    # Standard errors of a mean over 16 replicates within which it is 95 times of 100 (Student's t).
    return 2.13 * np.array([standard_error, slope * rms, rms, *tilt])
