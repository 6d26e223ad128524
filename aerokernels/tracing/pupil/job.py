"""Pupil jobs: what is asked of a pupil, by which quadrature it is answered, and the plan and the runs of its rays."""

from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
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
from ..engines.info import memory_of
from ..grid_tables import prepare_grid
from ..lines import box_size
from ..plan import TracePlan
from ..planning import check_choices, plan_rays
from ..stop import Plane, plane_beyond
from .air import SAMPLE_RAYS, PupilAir, pupil_air, some_rays
from .run import PupilRun

REPLICATES = 16
# The seed of the points that decide which lattice is taken.
PILOT_SEED = 0x1A771CE


@dataclass(frozen=True)
class Quadrature:
    """The rays of a replicate: requested, of radial quadrature (0: the whole disc), and of possible lattices.

    With `is_known` the first lattice is taken without a trial.
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
    """What is asked of a pupil toward a unit vector, through whatever field: see `estimate_strehl`."""

    pupil: Pupil
    look: np.ndarray
    remove: tuple[str, ...]
    ray_count: int
    symmetry: str | bool
    bundle: str
    choices: dict[str, Any]

    def job(self, field: IndexField, wavelength: float, like: "PupilJob | None" = None) -> "PupilJob":
        """Plan the pupil's rays through a field.

        `like` is a job of this request through a field like this one: its results are confirmed, not searched again.
        """
        pupil, look, choices = self.pupil, self.look, self.choices
        _check_size(field, pupil)
        check_choices(field, **{name: choices[name] for name in ("method", "precision", "tolerance", "step")})
        pilot, air_rays = (None, None) if like is None else like.samples
        if like is not None and isinstance(field.samples, UniformGrid):
            # Without what is cached on it: tables of a device, rounded otherwise, must not meet other calls.
            grid = copy(field.samples)
            vars(grid)["extremes"] = field.samples.extremes
            field = replace(field, samples=grid)
            if like.plan.sample_count:
                with memory_of(like.plan.device):
                    prepare_grid(engine_of(like.plan.backend, like.plan.device), grid)
        air = pupil_air(field, pupil, look, choices["tolerance"] * wavelength, air_rays)
        until, quadrature = plane_beyond(field, pupil, look), self._quadrature(field, like)
        is_radial = quadrature.radial > 0
        task = PupilTask(
            field,
            pupil,
            look,
            until,
            None,  # type: ignore[arg-type]  # the plan of the first run, below
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
        pilot = pilot or some_rays(field.samples.places, pupil, look, PILOT_RAYS)
        job = PupilJob(self, task, quadrature, air, pilot, None if like is None else like.plan)
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
    """A planned pupil that can be traced for any number of seeds; `pilot` are some of its rays.

    `task` has fewer rays than requested if radial quadrature replaces the disc. `known_plan` is that of a job for
    another field, from which this one was made.
    """

    request: PupilRequest
    task: PupilTask
    quadrature: Quadrature
    air: PupilAir
    pilot: RayBundle
    known_plan: TracePlan | None = None
    finer_runs: dict[int, PupilRun] = field(default_factory=dict)

    @property
    def plan(self) -> TracePlan:
        """How the rays of the first run are traced, as planned before any is traced."""
        return self.task.plan

    def plan_for(self, rays: int) -> TracePlan:
        """The plan for a number of rays; tables are made only if there are enough rays for them to pay."""
        task = self.task
        plan = _plan_of(
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

    @cached_property
    def samples(self) -> tuple[RayBundle | None, RayBundle | None]:
        """The pilot rays, and the rays that show what the pupil misses, for jobs made from this one."""
        if self.known_plan is not None:
            return self.pilot, self.air.rays
        if not self.task.is_radial:
            # A known number of samples is confirmed by one in this many of the rays that were used to find it.
            return self.pilot.rows(slice(None, None, 2)), self.air.rays
        pupil, look = self.task.pupil, self.task.look
        # The sample rays of a symmetric pupil lie along a radius, so that this share of them is enough.
        pilot_rays, air_rays = (int(0.25 * count) for count in (PILOT_RAYS, SAMPLE_RAYS))
        return radial_bundle(pupil, look, pilot_rays), radial_bundle(pupil, look, air_rays)

    @cached_property
    def run(self) -> PupilRun:
        """The function that traces and sums the points of a seed; uploads and compiles when first read.

        The smallest lattice that suffices for the points of PILOT_SEED, so that no answer depends on other calls.
        """
        errors: dict[int, float] = {}
        for size in self.quadrature.sizes:
            if may_still_settle(errors, size):
                tried = self._runner(size, LATTICES[size])
                if self.quadrature.is_known:
                    return tried
                errors[size] = tried(PILOT_SEED).standard_error
                if errors[size] <= ENOUGH:
                    return tried
        return self._runner(self.task.per_replicate)

    def _runner(self, per_replicate: int, generator: int = 0) -> PupilRun:
        """Prepare so many rays of a replicate on the backend of their plan."""
        plan = self.plan_for(per_replicate * REPLICATES)
        task = replace(self.task, plan=plan, per_replicate=per_replicate, generator=generator)
        if plan.backend == "reference":
            from ..engines.reference.pupil import PupilRun as ReferencePupilRun

            return ReferencePupilRun(task)  # type: ignore[return-value]  # called alike
        with memory_of(plan.device):
            return PupilRun(task)

    @property
    def finer_sizes(self) -> list[int]:
        """Rays of a replicate of runs with more rays than the first, up to the requested number."""
        most = self.quadrature.per_replicate
        possible = {RADIAL_RAYS, most} if self.task.is_radial else {most}
        return sorted(size for size in possible if self.run.task.per_replicate < size <= most)

    def finer(self, per_replicate: int) -> PupilRun:
        """The run with so many rays of a replicate, which is made when it is first asked for."""
        if per_replicate not in self.finer_runs:
            self.finer_runs[per_replicate] = self._runner(per_replicate)
        return self.finer_runs[per_replicate]

    def settled(self, run: PupilRun) -> float:
        """The standard error of the Strehl ratio of a run above which the next finer run is traced."""
        if run.task.generator:
            return ACCEPTED
        return SETTLED if run.task.per_replicate >= RADIAL_RAYS else ENOUGH

    def planned(self, run: PupilRun, *more: str) -> TracePlan:
        """The plan of a run, including the reasons for the choice of rays and for taking more of them."""
        asked, first = f"{self.quadrature.per_replicate * REPLICATES:,} over the pupil", self.run.task
        if first.generator:
            lattice = f"{REPLICATES} x {first.per_replicate} points of shifted lattices instead of {asked}"
            more = f"the wavefront is smooth: {lattice}", *more
        elif self.quadrature.sizes:
            more = f"{asked}: the wavefront is too rough, or cut, for fewer", *more
        return replace(run.task.plan, reasons=(*run.task.plan.reasons, *more)) if more else run.task.plan


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


def _check_size(field: IndexField, pupil: Pupil) -> None:
    """Reject a pupil so much larger than the field that hardly one ray in a hundred would meet it."""
    size = 0.5 * box_size(field)
    if pupil.reach > 10.0 * size:
        raise ValueError(
            f"the pupil's reach of {pupil.reach:g} m is {pupil.reach / size:.0f} times the field's {size:.3g} m: "
            "hardly any ray meets the field; give metres, 6e-3 for 6 mm"
        )
