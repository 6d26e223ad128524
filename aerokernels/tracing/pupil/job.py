"""Pupil jobs: what is asked of a pupil, by which quadrature it is answered, and the plan and the runs of its rays."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from typing import Any

import numpy as np

from aerokernels.tracing.tasks.quadrature import (
    ACCEPTED,
    ENOUGH,
    LATTICES,
    RADIAL_RAYS,
    SETTLED,
    choose_radial,
    fewer_rays,
    lattice_sizes,
    may_still_settle,
    radial_bundle,
)
from aerokernels.tracing.tasks.sums import PupilTask

from ...derived import cached_on
from ...medium import IndexField
from ...medium.grid import UniformGrid
from ...rays import PILOT_RAYS, Pupil, RayBundle
from ..engines import engine_of
from ..engines.device_memory import memory_of
from ..grid_tables import begun_grid
from ..lines import box_size
from ..plan import TracePlan
from ..planning import check_choices, plan_rays
from ..stop import Plane, plane_beyond
from .air import SAMPLE_RAYS, PupilAir, pupil_air
from .run import PupilRun

REPLICATES = 16
# The seed of the points that decide which lattice is taken.
PILOT_SEED = 0x1A771CE
# The greatest reach of a pupil, over half of the diagonal of the field's box.
GREATEST_RATIO = 10.0
# A known number of samples is confirmed by one in this many of the rays that were used to find it.
CONFIRMING = 2
# The sample rays of a symmetric pupil lie along a radius, so that this share of them is enough.
ALONG_RADIUS = 0.25


@dataclass(frozen=True)
class Quadrature:
    """The rays of a replicate.

    Attributes:
        per_replicate: Requested rays.
        radial: Rays of radial quadrature, which replaces the disc; 0 for the whole disc.
        sizes: Points of the lattices that may replace the requested ones.
        is_known: Whether the first lattice is taken without a trial.
        reason: The choice in words.
    """

    per_replicate: int
    radial: int
    sizes: tuple[int, ...]
    is_known: bool
    reason: str

    @property
    def first(self) -> int:
        """Rays of the first run, predicted before any is traced."""
        return self.sizes[0] if self.sizes else self.radial or self.per_replicate

    @property
    def most(self) -> int:
        """Rays of all replicates, at most, for which planning may pay."""
        return REPLICATES * (min(self.per_replicate, RADIAL_RAYS) if self.radial else self.per_replicate)


@dataclass(frozen=True, eq=False)
class PupilRequest:
    """What is asked of a pupil, through whatever field.

    Attributes:
        pupil: The pupil.
        look: Direction of its rays, a unit vector, shape (3,).
        remove: Terms removed from the wavefront.
        ray_count: Requested rays.
        symmetry: See `estimate_strehl`.
        bundle: See `estimate_strehl`.
        choices: The options of the trace, see TraceOptions.
    """

    pupil: Pupil
    look: np.ndarray
    remove: tuple[str, ...]
    ray_count: int
    symmetry: str | bool
    bundle: str
    choices: dict[str, Any]

    def job(
        self, field: IndexField, wavelength: float, like: "PupilJob | None" = None, plan: TracePlan | None = None
    ) -> "PupilJob":
        """Plan the pupil's rays through a field.

        `like` is a job of this request through a field like this one: its results are confirmed, not searched again.
        With `plan` nothing is planned: it is the job's plan.

        Raises:
            ValueError: A name or number that makes no sense; symmetry=True without symmetry; no ray meets the field.
        """
        pupil, look, choices = self.pupil, self.look, self.choices
        _check_size(field, pupil)
        check_choices(field, **{name: choices[name] for name in ("method", "precision", "tolerance", "step")})
        pilot, air_rays = (None, None) if like is None else like.samples
        begun = _begun(field, like)  # the device computes tables while the host examines what the pupil misses
        try:
            air = pupil_air(field, pupil, look, choices["tolerance"] * wavelength, air_rays)
        finally:
            begun()
        until, quadrature = plane_beyond(field, pupil, look), self._quadrature(field, like)
        is_radial = quadrature.radial > 0
        task = PupilTask(
            field,
            pupil,
            look,
            until,
            plan,  # type: ignore[arg-type]  # the plan of the first run, below
            wavelength,
            quadrature.radial or quadrature.per_replicate,
            REPLICATES,
            # A symmetric wavefront has no tilt, and the piston changes no Strehl ratio.
            terms=tuple(term for term in self.remove if term == "focus" or (term == "tilt" and not is_radial)),
            # In an axisymmetric field, rays at one radius from a pupil centre on the axis meet the same air.
            by_radius=field.geometry == "axisymmetric"
            and pupil.inner_ratio is not None
            and float(np.hypot(*pupil.center[:2])) < 0.05 * pupil.reach,
            is_radial=is_radial,
        )
        pilot = pilot or _pilot_of(field.samples.places, pupil, look)
        job = PupilJob(self, task, quadrature, air, pilot, None if like is None else like.plan, plan)
        job.task = replace(task, plan=job.plan_for(REPLICATES * quadrature.first))
        return job

    def _quadrature(self, field: IndexField, like: "PupilJob | None") -> Quadrature:
        """Choose the rays of a replicate: those of a job `like` this one, if they may be enough here."""
        pupil, per_replicate = self.pupil, -(-self.ray_count // REPLICATES)  # rounded up
        sizes = lattice_sizes(field, pupil, per_replicate, REPLICATES, self.bundle)
        most = RADIAL_RAYS if like is None else fewer_rays(field, pupil, REPLICATES)
        radial, why = choose_radial(field, pupil, self.look, per_replicate, REPLICATES, self.symmetry, most)
        taken = 0 if like is None or not like.run.task.generator else like.run.task.per_replicate
        is_known = taken in sizes and not radial
        return Quadrature(per_replicate, radial, () if radial else (taken,) if is_known else sizes, is_known, why)


@dataclass(eq=False)
class PupilJob:
    """A planned pupil that can be traced for any number of seeds.

    Attributes:
        request: What is asked.
        task: The pupil to trace; with fewer rays if radial quadrature replaces the disc.
        quadrature: The choice of rays.
        air: What the rays miss of the flow.
        pilot: Some of its rays.
        known_plan: The plan of a job for another field, from which this one was made; None where it was not.
        fixed_plan: The plan for any number of rays; None plans for each.
        base: The job whose plan this one's field follows (new_values.py); None where it has its own.
        prepared: A run, like PupilRun, that is prepared already; None prepares one when it is needed.
        shared: The NewValues that jobs made from this one share, or None where their fields are each planned; empty
            until the first is made, while `lock` is held.
    """

    request: PupilRequest
    task: PupilTask
    quadrature: Quadrature
    air: PupilAir
    pilot: RayBundle
    known_plan: TracePlan | None = None
    fixed_plan: TracePlan | None = None
    base: "PupilJob | None" = None
    prepared: Any = None
    shared: list[Any] = field(default_factory=list)
    lock: Any = field(default_factory=threading.Lock)

    @property
    def plan(self) -> TracePlan:
        """How the rays of the first run are traced, as planned before any is traced."""
        return self.task.plan

    def plan_for(self, rays: int) -> TracePlan:
        """The plan for a number of rays; tables are made only if there are enough rays for them to pay."""
        task = self.task
        if self.base is not None:
            return self.request.job(task.field, task.wavelength, like=self.base).plan_for(rays)
        plan = self.fixed_plan or _plan_of(
            task.field,
            self.pilot,
            task.until,
            task.look,
            task.wavelength,
            self.quadrature.most,
            rays,
            self.known_plan,
            self.request.choices,
        )
        return replace(plan, reasons=(*plan.reasons, *self.air.reasons, self.quadrature.reason))

    @property
    def predicted_ray_count(self) -> int:
        """Rays of the first run, predicted before any is traced."""
        return self.quadrature.first * REPLICATES

    @property
    def traced_ray_count(self) -> int:
        """Rays of the first run."""
        return self.run.task.per_replicate * REPLICATES

    @property
    def is_radial(self) -> bool:
        """Whether radial quadrature replaces the disc: field, pupil and rays are symmetric about the axis."""
        return self.task.is_radial

    def settled(self, run: PupilRun) -> float:
        """The standard error of the Strehl ratio of a run above which the next finer run is traced."""
        if run.task.generator:
            return ACCEPTED
        return SETTLED if run.task.per_replicate >= RADIAL_RAYS else ENOUGH

    @cached_property
    def samples(self) -> tuple[RayBundle | None, RayBundle | None]:
        """The pilot rays, and the rays that show what the pupil misses, for jobs made from this one."""
        if self.known_plan is not None:
            return self.pilot, self.air.rays
        if not self.is_radial:
            return self.pilot.rows(slice(None, None, CONFIRMING)), self.air.rays
        pupil, look = self.task.pupil, self.task.look
        pilot_rays, air_rays = (int(ALONG_RADIUS * count) for count in (PILOT_RAYS, SAMPLE_RAYS))
        return radial_bundle(pupil, look, pilot_rays), radial_bundle(pupil, look, air_rays)

    @cached_property
    def run(self) -> PupilRun:
        """The function that traces and sums the points of a seed; uploads and compiles when first read.

        The smallest lattice is taken that is accurate enough for the points of PILOT_SEED, so that no answer depends on
        other calls.
        """
        if self.prepared is not None:
            return self.prepared
        errors: dict[int, float] = {}
        for size in self.quadrature.sizes:
            if may_still_settle(errors, size):
                tried = _runner(self._of_lattice(size))
                if self.quadrature.is_known:
                    return tried
                errors[size] = tried(PILOT_SEED).standard_error
                if errors[size] <= ENOUGH:
                    return tried
        return _runner(replace(self.task, plan=self.plan_for(self.task.per_replicate * REPLICATES)))

    def _of_lattice(self, size: int) -> PupilTask:
        """The task with the points of a lattice."""
        plan = self.plan_for(size * REPLICATES)
        return replace(self.task, plan=plan, per_replicate=size, generator=LATTICES[size])

    @property
    def known_task(self) -> PupilTask:
        """The task of the first run, if that is known without a trial."""
        return self._of_lattice(self.quadrature.sizes[0]) if self.quadrature.sizes else self.task

    @cached_property
    def finer_runs(self) -> list[Callable[[], PupilRun]]:
        """Runs with more rays than the first, up to the requested number; each is made when it is first called."""
        most = self.quadrature.per_replicate
        possible = {RADIAL_RAYS, most} if self.is_radial else {most}
        sizes = sorted(size for size in possible if self.run.task.per_replicate < size <= most)
        return [cache(partial(_finer_run, self.task, self.plan_for, size)) for size in sizes]

    @cached_property
    def planned(self) -> TracePlan:
        """The plan of the first run, including the reasons for its choice of rays."""
        return self._with_reasons(self.run.task.plan)

    def planned_for(self, run: PupilRun, *more: str) -> TracePlan:
        """The plan of a run, including the reasons for its choice of rays and for taking more of them."""
        return self.planned if run is self.run else self._with_reasons(run.task.plan, *more)

    def _with_reasons(self, plan: TracePlan, *more: str) -> TracePlan:
        """The plan with the reasons for the choice of rays."""
        size = self.run.task.per_replicate if self.run.task.generator else 0
        asked = f"{self.quadrature.per_replicate * REPLICATES:,} over the pupil"
        if size:
            more = (
                f"the wavefront is smooth: {REPLICATES} x {size} points of shifted lattices instead of {asked}",
                *more,
            )
        elif self.quadrature.sizes:
            more = f"{asked}: the wavefront is too rough, or cut, for fewer", *more
        return replace(plan, reasons=(*plan.reasons, *more)) if more else plan


@cached_on("field", 4)
def _plan_of(
    field: IndexField,
    pilot: RayBundle,
    until: Plane,
    look: np.ndarray,
    wavelength: float,
    count: int,
    sure_count: int,
    like: TracePlan | None,
    choices: dict[str, Any],
) -> TracePlan:
    return plan_rays(
        field,
        lambda: pilot,
        count,
        until,
        path_length=None,
        wavelength=wavelength,
        directions=look[None],
        like=like,
        sure_count=sure_count,
        **choices,
    )


@cached_on("places", 4)
def _pilot_of(places: Any, pupil: Pupil, look: np.ndarray) -> RayBundle:
    """Some of a pupil's rays; one object for all fields on the same nodes, because rays cache where they cross them."""
    return RayBundle.collimated(pupil, PILOT_RAYS, direction=look)


def _begun(field: IndexField, like: PupilJob | None) -> Callable[[], None]:
    """Start the tables of a grid that a job like this one needs; return a function that waits for them."""
    if like is None or not like.plan.sample_count or not isinstance(field.samples, UniformGrid):
        return lambda: None
    with memory_of(like.plan.device):
        return begun_grid(engine_of(like.plan.backend, like.plan.device), field.samples)


def _check_size(field: IndexField, pupil: Pupil) -> None:
    """Reject a pupil so much larger than the field that hardly one ray in a hundred would meet it."""
    size = 0.5 * box_size(field)
    if pupil.reach > GREATEST_RATIO * size:
        raise ValueError(
            f"the pupil's reach of {pupil.reach:g} m is {pupil.reach / size:.0f} times the field's {size:.3g} m: "
            "hardly any ray meets the field; give metres, 6e-3 for 6 mm"
        )


def _runner(task: PupilTask):
    """Prepare a task on the backend of its plan."""
    if task.plan.backend == "reference":
        from ..engines.reference.pupil import PupilRun as ReferencePupilRun

        return ReferencePupilRun(task)
    with memory_of(task.plan.device):
        return PupilRun(task)


def _finer_run(task: PupilTask, plan_for: Callable[[int], TracePlan], per_replicate: int):
    """Prepare the task with so many rays of a replicate."""
    return _runner(replace(task, plan=plan_for(per_replicate * REPLICATES), per_replicate=per_replicate))
