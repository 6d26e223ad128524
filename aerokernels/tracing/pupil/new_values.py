"""Follow a known pupil's plan through new values on the nodes of its grid, where the plan holds for them.

A job for another field on the same nodes differs in little, so that what is launched for it is prepared once
(values_in_turn.py). What the plan rests on is then examined for the field's own values:

- the OPD error allowed to a ray is the same (error_limit.py);
- the air outside the plan's support is as undisturbed as may be left out (support.py); the support is that of a
  stricter limit than the plan's, so that it also holds for slightly stronger fields;
- structure between samples is bounded (leapfrog/between_samples.py); the number of samples suffices for somewhat
  stronger fields than the known one;
- the pilot's error, and the scales that let each ray's own estimate cover it, suffice (leapfrog/pilot_levels.py).

Where one of these does not hold, the field is planned as before, with the known number of samples as a guess. All
fields asked of one job are compared with that job's field alone, so that no answer depends on the order of the calls.
"""

import threading
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...medium import IndexField
from ...medium.grid import UniformGrid
from ..engines import engine_of
from ..engines.device_memory import DeviceMemoryError, memory_of
from ..error_limit import error_limit, left_out, support_box
from ..grid_tables import has_tables, keep_tables, prepare_grid
from ..leapfrog.between_samples import MissedStructure
from ..leapfrog.pilot import GREATEST_BEND, GREATEST_SHARE, SAFETY, pair_of
from ..leapfrog.sample_count import judged_pair, leapfrog_reason, least_samples
from ..leapfrog.unresolved import potential_by_blocks
from ..plan import TracePlan
from ..step_bound import roughness_of_blocks
from ..straight_lines import LeverArms
from .air import pupil_air
from .job import UNKNOWN, PupilJob
from .run import PupilRun
from .sums import PupilSums, PupilTask
from .values_in_turn import MemoryInTurn, ValuesInTurn

# The plan is made for fields that are stronger by this factor.
STRONGER = 1.5
# The support is that of a limit this many times stricter.
STRICTER = 8.0
# In a field so weak that the limit is a share of its own OPD, rays are kept within that of fields so many times weaker.
WEAKER = 2.0
# The scales of a ray's own error estimate are up to WIDER times those of the known field: small errors are mostly
# rounding, and their scales differ from field to field. They hold for a field that needs scales up to GREATER times
# greater, because they cover the pilot's error SAFETY times (pilot_levels.py). They do not matter where the pilot's
# error is below the share NEGLIGIBLE of the limit.
WIDER, GREATER, NEGLIGIBLE = 4.0, 1.5, 0.01
# Bytes of memory for each node, and the share of a device's memory that it may take.
BYTES, MEMORY_SHARE = 32, 0.05

# Makes the job of a field by planning it: `make_job` with all that the jobs have in common.
MakeJob = Callable[..., PupilJob]


def next_job(make: MakeJob, like: PupilJob, field: IndexField, wavelength: float) -> PupilJob:
    """Return the job of a field by the plan of another job, where that holds for it, or by one of its own.

    Raises:
        ValueError: As for `make_job`.
    """
    with like.lock:
        if like.new_values is UNKNOWN:
            like.new_values = NewValues.of(make, like)
    known: NewValues | None = like.new_values
    field = _bare(field)
    job = None if known is None else known.job_of(field, wavelength)
    if job is None:
        job = make(field, wavelength=wavelength, like=like)
        job.new_values = known
    return job


@dataclass(eq=False)
class NewValues:
    """A plan that fields on the same nodes may follow, what it rests on, and the memory in which they do.

    Attributes:
        make: Makes a job by planning.
        job: The job of a field that is the known one but for its identity, which may go out of use.
        task: Its task, with the plan that others follow.
        structure: The structure that rays may miss between samples.
        limit: The OPD error allowed to a ray [m].
        box: The support.
        memory: The memory.
    """

    make: MakeJob
    job: PupilJob
    task: PupilTask
    structure: MissedStructure
    limit: float
    box: tuple[np.ndarray, np.ndarray]
    memory: MemoryInTurn

    @classmethod
    def of(cls, make: MakeJob, like: PupilJob) -> "NewValues | None":
        """Find the plan that other fields may follow, from a job whose plan is to hold for them; None without one."""
        known, plan = _bare(like.task.field), like.run.task.plan
        if not _may_be_followed(known, plan):
            return None
        tolerance, arms = plan.tolerance * like.task.wavelength, plan.lever_arms
        limit = known_limit = error_limit(known, tolerance)
        if limit < tolerance:
            limit /= WEAKER
        if np.isfinite(left_out(known, limit, arms)[1]):
            return None  # the slopes that may be left out depend on the field
        told = len(like.air.reasons) + 1  # the last are those of the pupil's air and of the rays
        plan = replace(plan, sampling=None, reasons=plan.reasons[:-told])
        job = make(known, wavelength=like.task.wavelength, like=like, plan=plan)
        if job.sizes and not job.is_known:
            return None
        box = support_box(known, limit / STRICTER, arms)
        field = _twin(known, tolerance, limit, arms, box)
        # With samples for STRONGER fields; their number is hardly greater, since errors fall with its fourth power.
        structure = MissedStructure(field, job.pilot, job.until, limit, arms, job.pilot)
        strict = structure.of_values(field, known_limit / STRONGER)
        count = strict.sufficient(max(plan.searched_count, least_samples(field, job.pilot, limit, arms)))
        if not count:
            return None
        plan = job.known_task.plan
        plan = replace(plan, sample_count=count, steepest=structure.steepness, predicted_evaluations=float(count))
        task = replace(job.known_task, field=field, plan=plan)
        try:
            with memory_of(plan.device):
                place = ValuesInTurn(task, job.pilot)
                place.load(known)
                wider = _wider_scales(place.read(known), count, limit)
                if wider is None:
                    return None
                plan = replace(plan, quadrature_error_scale=wider[0], trajectory_error_scale=wider[1])
                task = replace(task, plan=plan)
                place.prepare(task)
        except DeviceMemoryError:
            return None  # each field by itself may fit
        # Without the known job's own function, which would keep its field.
        asked = replace(job.task, field=field, plan=plan)
        job = replace(job, task=asked, plan_of=_nothing_more, given_run=place.run, lock=threading.Lock())

        def another() -> ValuesInTurn:
            alike = replace(task, field=found.twin(field))
            return ValuesInTurn(alike, job.pilot).prepare(alike)

        found = cls(make, job, task, structure, limit, box, MemoryInTurn(place, another))
        return found

    def job_of(self, field: IndexField, wavelength: float) -> PupilJob | None:
        """Return the job of a field that follows the plan; None where it does not hold.

        Raises:
            ValueError: No ray of the pupil meets the field's air.
        """
        task, job = self.task, self.job
        if not self._is_alike(field, wavelength):
            return None
        tolerance = task.plan.tolerance * task.wavelength
        with memory_of(task.plan.device), self.memory.taken() as place:
            place.load(field)
            try:  # while a GPU works
                limit = error_limit(field, tolerance)
                air = pupil_air(field, task.pupil, task.look, tolerance, job.air.rays)
            finally:
                pilots = place.read(field)
            worst = self._worst(field, limit, pilots)
            if worst is None:
                place.leave(field)
                return None
        worst /= task.wavelength
        reason = leapfrog_reason(task.plan.sample_count, job.pilot.ray_count, worst)
        last, told = task.plan.reasons[-1], len(job.air.reasons) + 1
        reasons = (reason, *task.plan.reasons[1:-told], *air.reasons, last)
        plan = replace(task.plan, predicted_error=worst, reasons=reasons)
        return replace(
            job,
            plan=plan,
            plan_of=lambda rays: self.make(field, wavelength=wavelength, like=job).plan_of(rays),  # for more rays
            task=replace(job.task, field=field, plan=plan),
            air=air,
            given_run=FollowedRun(self, field, plan),
            new_values=self,
            lock=threading.Lock(),
        )

    def _worst(self, field: IndexField, limit: float, pilots: list[dict[str, np.ndarray]]) -> float | None:
        """The pilot's greatest error [m] in a field whose tables are known; None where the plan does not hold.

        `limit` is the OPD error allowed there [m].
        """
        plan = self.task.plan
        judged = judged_pair(pair_of(pilots, plan.sample_count), limit)
        if judged is None or limit < self.limit:
            return None
        (scales, worst), held = judged, (plan.quadrature_error_scale, plan.trajectory_error_scale)
        covers = all(needed <= GREATER * scale for needed, scale in zip(scales, held, strict=True))
        low, high = support_box(field, self.limit, plan.lever_arms)
        is_within = (low == high).all() or ((low >= self.box[0]).all() and (high <= self.box[1]).all())
        if not (covers or worst <= NEGLIGIBLE * limit) or not is_within:
            return None
        # For volumes the sharper bound takes longer than to plan anew.
        structure, by_rule = self.structure.of_values(field, limit), field.geometry == "volume"
        return worst if structure.is_enough(plan.sample_count, by_rule) else None

    def _is_alike(self, field: IndexField, wavelength: float) -> bool:
        """Whether a field has all of the known field but the values, and these are hardly greater."""
        known, samples, known_samples = self.task.field, field.samples, self.task.field.samples
        if not (isinstance(samples, UniformGrid) and isinstance(known_samples, UniformGrid)):
            return False
        is_alike = (
            samples.places is known_samples.places
            and samples.interpolation == known_samples.interpolation
            and (field.geometry, field.ambient_index) == (known.geometry, known.ambient_index)
            and field.body is known.body
            and wavelength == self.task.wavelength
        )
        # Errors grow with the contrast: a field that is stronger by more need not be examined.
        return is_alike and _strength(samples) <= STRONGER * _strength(known_samples)

    def twin(self, field: IndexField) -> IndexField:
        """A field of the same values on which nothing is cached but what the plan says: tables, limit and support."""
        task, arms = self.task, self.task.plan.lever_arms
        return _twin(field, task.plan.tolerance * task.wavelength, self.limit, arms, self.box)


@dataclass(eq=False)
class FollowedRun:
    """The pupil's rays through a field that follows a plan: in memory that fields use in turn, or later in its own.

    Attributes:
        known: The plan that it follows.
        field: The field.
        plan: The plan of the field itself.
    """

    known: NewValues
    field: IndexField
    plan: TracePlan
    own: PupilRun | None = None

    @cached_property
    def task(self) -> PupilTask:
        """The task of the field."""
        return replace(self.known.task, field=self.field, plan=self.plan)

    def __call__(self, seed: int | None) -> PupilSums:
        """Trace and sum the points of a seed."""
        if self.own is None:
            found = self.known.memory.sums(seed, self.field)
            if found is not None:
                return found
            plan, twin = self.plan, self.known.twin(self.field)
            assert isinstance(twin.samples, UniformGrid)
            with memory_of(plan.device):  # another field has taken the memory
                prepare_grid(engine_of(plan.backend, plan.device), twin.samples)
                self.own = PupilRun(replace(self.task, field=twin))
        return self.own(seed, self.field)


def _may_be_followed(field: IndexField, plan: TracePlan) -> bool:
    """Whether a plan has leapfrog samples of the spline itself, on a device that computes a grid's tables."""
    grid = field.samples
    if not (plan.searched_count and isinstance(grid, UniformGrid)) or plan.cubes:
        return False
    engine = engine_of(plan.backend, plan.device)
    return has_tables(engine, grid) and BYTES * grid.samples.size <= MEMORY_SHARE * engine.memory[0]


def _nothing_more(rays: int) -> TracePlan:
    raise AssertionError(f"the plan that others follow is not asked for one of {rays} rays")


def _strength(grid: UniformGrid) -> float:
    """The greatest absolute contrast."""
    low, high = grid.extremes
    return max(-low, high)


def _wider_scales(made: list[dict[str, np.ndarray]], count: int, limit: float) -> tuple[float, float] | None:
    """Scales of a ray's error up to WIDER times those that the pilot needs, if they reject no ray of it.

    None for a pilot that is not accurate. `made` are the outputs of its trials, and `limit` is a ray's [m].
    """
    judged = judged_pair(pair_of(made, count), limit)
    if judged is None:
        return None
    (share, bend), worst = judged
    wider = WIDER if worst <= 0.0 else min(max(0.5 * limit / (SAFETY * worst), 1.0), WIDER)
    return min(wider * share, GREATEST_SHARE), min(wider * bend, GREATEST_BEND)


def _bare(field: IndexField) -> IndexField:
    """The same field with nothing cached on it: tables of a device, rounded otherwise, must not meet other calls."""
    grid = field.samples
    if not isinstance(grid, UniformGrid):
        return field
    other = copy(grid)
    vars(other)["extremes"] = grid.extremes
    return replace(field, samples=other)


def _twin(
    field: IndexField, tolerance: float, limit: float, arms: LeverArms | None, box: tuple[np.ndarray, np.ndarray]
) -> IndexField:
    """A field of the same values on which nothing is cached but its tables, this limit [m] and this support."""
    grid = field.samples
    assert isinstance(grid, UniformGrid)
    other = replace(grid)
    keep_tables(other, {each: each(grid) for each in (roughness_of_blocks, potential_by_blocks)})
    twin = replace(field, samples=other)
    error_limit.keep(limit, twin, tolerance)
    support_box.keep(box, twin, limit, arms)
    return twin
