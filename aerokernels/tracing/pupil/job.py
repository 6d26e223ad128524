"""Pupil jobs: plan a pupil's rays and prepare them on the backend of the plan."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from typing import Any

import numpy as np

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
from .quadrature import (
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
from .run import PupilRun
from .sums import PupilTask

REPLICATES = 16
# The seed of the points that decide which lattice is taken.
PILOT_SEED = 0x1A771CE
# The greatest reach of a pupil, over half of the diagonal of the field's box.
GREATEST_RATIO = 10.0
# In place of what is not examined yet.
UNKNOWN = object()
# A known number of samples is confirmed by one in this many of the rays that were used to find it.
CONFIRMING = 2
# The sample rays of a symmetric pupil lie along a radius, so that this share of them is enough.
ALONG_RADIUS = 0.25


@dataclass(eq=False)
class PupilJob:
    """A planned pupil that can be traced for any number of seeds.

    Attributes:
        plan: How the rays of the first run are traced.
        plan_of: Returns the plan for a number of rays; tables are made only if there are enough rays for them to pay.
        until: The plane at which its rays stop.
        per_replicate: Requested rays of a replicate.
        task: The pupil to trace; with fewer rays if radial quadrature replaces the disc.
        air: What the rays miss of the flow.
        pilot: Some of its rays.
        sizes: Points of the lattices that may replace the points of `task`, see lattice_quadrature.py.
        is_known: Whether the first of them is taken without a trial.
        is_alike: Whether the job was made from a job for another field.
        given_run: A run, like PupilRun, that is prepared already; None prepares one when it is needed.
        new_values: The NewValues of new_values.py that jobs made from this one share; None where their fields are each
            planned; UNKNOWN until a job is made from this one, while `lock` is held.
    """

    plan: TracePlan
    plan_of: Callable[[int], TracePlan]
    until: Plane
    per_replicate: int
    task: PupilTask
    air: PupilAir
    pilot: RayBundle
    sizes: tuple[int, ...] = ()
    is_known: bool = False
    is_alike: bool = False
    given_run: Any = None
    new_values: Any = UNKNOWN
    lock: Any = field(default_factory=threading.Lock)

    @property
    def predicted_ray_count(self) -> int:
        """Rays of the first run, predicted before any is traced."""
        return (self.sizes[0] if self.sizes else self.task.per_replicate) * REPLICATES

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
        if self.is_alike:
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
        if self.given_run is not None:
            return self.given_run
        errors: dict[int, float] = {}
        for size in self.sizes:
            if may_still_settle(errors, size):
                tried = _runner(self._of_lattice(size))
                if self.is_known:
                    return tried
                errors[size] = tried(PILOT_SEED).standard_error
                if errors[size] <= ENOUGH:
                    return tried
        return _runner(replace(self.task, plan=self.plan_of(self.task.per_replicate * REPLICATES)))

    def _of_lattice(self, size: int) -> PupilTask:
        """The task with the points of a lattice."""
        plan = self.plan_of(size * REPLICATES)
        return replace(self.task, plan=plan, per_replicate=size, generator=LATTICES[size])

    @property
    def known_task(self) -> PupilTask:
        """The task of the first run, if that is known without a trial."""
        return self._of_lattice(self.sizes[0]) if self.sizes else self.task

    @cached_property
    def finer_runs(self) -> list[Callable[[], PupilRun]]:
        """Runs with more rays than the first, up to the requested number; each is made when it is first called."""
        possible = {RADIAL_RAYS, self.per_replicate} if self.is_radial else {self.per_replicate}
        sizes = sorted(size for size in possible if self.run.task.per_replicate < size <= self.per_replicate)
        return [cache(partial(_finer_run, self.task, self.plan_of, size)) for size in sizes]

    @cached_property
    def planned(self) -> TracePlan:
        """The plan of the first run, including the reasons for its choice of rays."""
        plan, chosen = self.run.task.plan, self._chosen
        return replace(plan, reasons=(*plan.reasons, *chosen)) if chosen else plan

    def planned_for(self, run: PupilRun, *more: str) -> TracePlan:
        """The plan of a run, including the reasons for its choice of rays and for taking more of them."""
        plan = run.task.plan
        return self.planned if run is self.run else replace(plan, reasons=(*plan.reasons, *self._chosen, *more))

    @property
    def _chosen(self) -> tuple[str, ...]:
        """The reasons for the choice of rays, in words."""
        size = self.run.task.per_replicate if self.run.task.generator else 0
        asked = f"{self.per_replicate * REPLICATES:,} over the pupil"
        if size:
            return (f"the wavefront is smooth: {REPLICATES} x {size} points of shifted lattices instead of {asked}",)
        return (f"{asked}: the wavefront is too rough, or cut, for fewer",) if self.sizes else ()


def make_job(
    field: IndexField,
    pupil: Pupil,
    look: np.ndarray,
    wavelength: float,
    ray_count: int,
    remove,
    symmetry,
    bundle: str = "auto",
    like: PupilJob | None = None,
    plan: TracePlan | None = None,
    **choices,
) -> PupilJob:
    """Plan a pupil; `choices` are those of `make_plan`.

    `like` is a job with the same choices through a field like this one: its results are confirmed, not searched again.
    With `plan` nothing is planned: it is the job's plan.

    Raises:
        ValueError: A name or number that makes no sense; symmetry=True without symmetry; no ray that meets the field.
    """
    _check_size(field, pupil)
    tolerance = choices["tolerance"]
    check_choices(field, **{name: choices[name] for name in ("method", "precision", "tolerance", "step")})
    pilot, air_rays = (None, None) if like is None else like.samples
    begun = _begun(field, like)  # the device computes tables while the host examines what the pupil misses
    try:
        air = pupil_air(field, pupil, look, tolerance * wavelength, air_rays)
    finally:
        begun()
    pilot = pilot or _pilot_of(field.samples.places, pupil, look)
    until = plane_beyond(field, pupil, look)
    per_replicate = -(-int(ray_count) // REPLICATES)  # rounded up
    sizes = lattice_sizes(field, pupil, per_replicate, REPLICATES, bundle)
    most = RADIAL_RAYS if like is None else fewer_rays(field, pupil, REPLICATES)
    radial_rays, why = choose_radial(field, pupil, look, per_replicate, REPLICATES, symmetry, most)
    count = min(per_replicate, RADIAL_RAYS) if radial_rays else per_replicate
    known_plan = None if like is None else like.plan  # so that `like` itself need not stay alive

    def plan_of(rays: int) -> TracePlan:
        made = plan or _plan_of(field, pilot, until, look, wavelength, REPLICATES * count, rays, known_plan, choices)
        return replace(made, reasons=(*made.reasons, *air.reasons, why))

    taken = 0 if like is None or not like.run.task.generator else like.run.task.per_replicate
    is_known = taken in sizes and not radial_rays
    sizes = () if radial_rays else (taken,) if is_known else sizes
    first = sizes[0] if sizes else radial_rays or per_replicate
    first_plan = plan_of(REPLICATES * first)
    task = PupilTask(
        field,
        pupil,
        look,
        until,
        first_plan,
        wavelength,
        radial_rays or per_replicate,
        REPLICATES,
        # A symmetric wavefront has no tilt, and the piston changes no Strehl ratio.
        terms=tuple(term for term in remove if term == "focus" or (term == "tilt" and not radial_rays)),
        # In an axisymmetric field, rays at one radius from a pupil centre on the axis meet the same air.
        by_radius=field.geometry == "axisymmetric"
        and pupil.inner_ratio is not None
        and float(np.hypot(*pupil.center[:2])) < 0.05 * pupil.reach,
        is_radial=radial_rays > 0,
    )
    return PupilJob(first_plan, plan_of, until, per_replicate, task, air, pilot, sizes, is_known, like is not None)


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
    """Reject a pupil so much larger than the field that hardly one ray in a hundred would meet it.

    Raises:
        ValueError: The pupil is more than ten times as large as the field.
    """
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


def _finer_run(task: PupilTask, plan_of: Callable[[int], TracePlan], per_replicate: int):
    """Prepare the task with so many rays of a replicate."""
    return _runner(replace(task, plan=plan_of(per_replicate * REPLICATES), per_replicate=per_replicate))
