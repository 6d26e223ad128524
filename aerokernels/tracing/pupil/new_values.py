"""Follow a known pupil's plan through new values on the nodes of its grid, where the plan holds for them.

A job for another field on the same nodes differs in little, so that what is launched for it is prepared once
(ValuesInTurn). What the plan rests on is then examined for the field's own values:

- the OPD error allowed to a ray is the same (error_limit.py);
- the air outside the plan's support is as undisturbed as may be left out (error_limit.py); the support is that of a
  stricter limit than the plan's, so that it also holds for slightly stronger fields;
- structure between samples is bounded (leapfrog/between_samples.py); the number of samples suffices for somewhat
  stronger fields than the known one;
- the pilot's error, and the scales that let each ray's own estimate cover it, suffice (leapfrog/pilot.py).

Where one of these does not hold, the field is planned as before, with the known number of samples as a guess. All
fields asked of one job are compared with that job's field alone, so that no answer depends on the order of the calls.
"""

import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from aerokernels.tracing.tasks.sums import PupilSums, PupilTask
from aerokernels.tracing.tasks.unresolved import potential_by_blocks

from ...medium import IndexField
from ...medium.grid import FETCH, UniformGrid
from ...rays import RayBundle
from ..engines import engine_of
from ..engines.device_memory import DeviceMemoryError, memory_of
from ..error_limit import error_limit, left_out, peaks_along_axes, potential_peaks, support_box
from ..grid_tables import GridTables, has_tables, keep_tables, prepare_grid
from ..launch import RepeatedTrials, Trials
from ..leapfrog.between_samples import MissedStructure
from ..leapfrog.pilot import GREATEST_BEND, GREATEST_SHARE, SAFETY, pair_numbers, pair_of
from ..leapfrog.sample_count import PILOT_OUTPUTS, judged_pair, leapfrog_reason, least_samples
from ..plan import TracePlan
from ..step_bound import roughness_of_blocks
from ..straight_lines import LeverArms
from .air import pupil_air
from .job import PupilJob
from .run import PupilRun

# The plan is made for fields that are stronger by this factor.
STRONGER = 1.5
# The support is that of a limit this many times stricter.
STRICTER = 8.0
# In a field so weak that the limit is a share of its own OPD, rays are kept within that of fields so many times weaker.
WEAKER = 2.0
# The scales of a ray's own error estimate are up to WIDER times those of the known field: small errors are mostly
# rounding, and their scales differ from field to field. They hold for a field that needs scales up to GREATER times
# greater, because they cover the pilot's error SAFETY times (pilot.py). They do not matter where the pilot's
# error is below the share NEGLIGIBLE of the limit.
WIDER, GREATER, NEGLIGIBLE = 4.0, 1.5, 0.01
# Bytes of memory for each node, and the share of a device's memory that it may take.
BYTES, MEMORY_SHARE = 32, 0.05


# Fields that may be in memory at a time, each used by one thread of a CPU.
MOST = 2  # speed only


class ValuesInTurn:
    """The memory, which one thread uses at a time.

    Attributes:
        lock: Held by the thread that uses it.
        run: The pupil's rays.
    """

    run: PupilRun

    def __init__(self, task: PupilTask, pilot: RayBundle):
        """Prepare the pilot of a task whose field nothing else uses: only those of others are loaded."""
        field, plan = task.field, task.plan
        grid = field.samples
        assert isinstance(grid, UniformGrid)
        self.lock = threading.Lock()
        self.field, self.precision = field, plan.precision
        self.engine = engine = engine_of(plan.backend, plan.device)
        self.tables = tables = GridTables(engine, grid)
        grid.derive(engine.grid_key, lambda: tables.coefficients)
        if tables.on_host is not None:
            on_host = tables.on_host.reshape(grid.coefficient_shape)
            grid.derive(FETCH, lambda: lambda: on_host)
        self.samples: Any = None  # on a CPU kernels read those of the fields themselves
        if engine.is_gpu:
            self.samples = engine.sent(engine.room((grid.samples.size,), np.float64))
        trials = Trials(field, pilot, plan, task.until, task.wavelength, PILOT_OUTPUTS)
        self.trials = RepeatedTrials(trials, pair_numbers(plan.sample_count))
        self.reading = engine.fetched(self.trials.arrays)  # in one copy
        self.trials.into(self.reading.buffers)
        self.repeat = engine.recorded()
        self._holds: Any = None  # refers weakly to the samples whose values are in memory

    def prepare(self, task: PupilTask) -> "ValuesInTurn":
        """Prepare the pupil's rays too, by a plan whose scales of a ray's error are known."""
        self.run = PupilRun(task)
        return self

    def holds(self, field: IndexField) -> bool:
        """Whether the values in memory are those of a field."""
        return self._holds is not None and self._holds() is field.samples

    def load(self, field: IndexField) -> None:
        """Start the launches for the values of a field; `read` must be called before anything else."""
        samples = field.samples
        assert isinstance(samples, UniformGrid)
        self._holds = None
        if self.samples is None:
            self._start(self.engine.share(samples.doubles))
        else:
            self.samples.send(samples.doubles)  # not with the launches, which may be replayed as one graph
            self.repeat(self._start_from_buffer)
        self._holds = weakref.ref(samples)

    def read(self, field: IndexField) -> list[dict[str, np.ndarray]]:
        """Wait for the launches, cache the tables on the loaded field, and return the pilot's rays (see pair_numbers).

        The rays are valid until the next load.
        """
        arrays = self.reading.wait()
        grid = field.samples
        assert isinstance(grid, UniformGrid)
        keep_tables(grid, self.tables.read())
        if self.tables.on_host is not None:
            potential_peaks.keep(peaks_along_axes(self.tables.on_host.reshape(grid.coefficient_shape)), grid)
        return self.trials.outputs(arrays)

    def leave(self, field: IndexField) -> None:
        """Leave a copy of the coefficients with the loaded field, which needs them again, on a CPU."""
        if self.tables.on_host is not None:
            coefficients = self.tables.on_host.reshape(field.samples.coefficient_shape).copy()
            coefficients.setflags(write=False)
            field.samples.derive(FETCH, lambda: lambda: coefficients)

    def _start_from_buffer(self) -> None:
        self._start(self.samples.buffer)

    def _start(self, samples: Any) -> None:
        """Start the launches for the samples in a buffer."""
        self.tables.start(samples)
        self.engine.renew(self.field, self.precision, self.tables.on_host)
        self.trials.launch()
        self.reading.start()


class MemoryInTurn:
    """Memory for as many fields at a time as threads use it."""

    def __init__(self, first: ValuesInTurn, another: Callable[[], ValuesInTurn]):
        """Take the first memory, and a function that prepares more of it."""
        self._another, self._places, self._lock = another, [first], threading.Lock()
        self._most = 1 if first.engine.is_gpu else MOST  # threads share the stream of a GPU

    @contextmanager
    def taken(self) -> Iterator[ValuesInTurn]:
        """Memory that no other thread uses meanwhile."""
        place = self._take()
        try:
            yield place
        finally:
            place.lock.release()

    def _take(self) -> ValuesInTurn:
        with self._lock:
            for place in self._places:
                if place.lock.acquire(blocking=False):
                    return place
            if len(self._places) < self._most:
                self._places.append(self._another())
            place = self._places[-1]
        place.lock.acquire()
        return place

    def sums(self, seed: int | None, field: IndexField) -> PupilSums | None:
        """Trace and sum the rays of a seed, if the field's values are still in memory."""
        for place in self._places:
            with place.lock:
                if place.holds(field):
                    return place.run(seed, field)
        return None


def next_job(like: PupilJob, field: IndexField, wavelength: float) -> PupilJob:
    """Return the job of a field by the plan of another job, where that holds for it, or by one of its own.

    Raises:
        ValueError: As for `PupilRequest.job`.
    """
    with like.lock:
        if not like.shared:
            like.shared.append(NewValues.of(like))
    known: NewValues | None = like.shared[0]
    field = _bare(field)
    job = None if known is None else known.job_of(field, wavelength)
    if job is None:
        job = like.request.job(field, wavelength, like=like)
        job.shared.append(known)
    return job


@dataclass(eq=False)
class NewValues:
    """A plan that fields on the same nodes may follow, what it rests on, and the memory in which they do.

    Attributes:
        job: The job of a field that is the known one but for its identity, which may go out of use.
        task: Its task, with the plan that others follow.
        structure: The structure that rays may miss between samples.
        limit: The OPD error allowed to a ray [m].
        box: The support.
        memory: The memory.
    """

    job: PupilJob
    task: PupilTask
    structure: MissedStructure
    limit: float
    box: tuple[np.ndarray, np.ndarray]
    memory: MemoryInTurn

    @classmethod
    def of(cls, like: PupilJob) -> "NewValues | None":
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
        job = like.request.job(known, like.task.wavelength, like, plan)
        if job.quadrature.sizes and not job.quadrature.is_known:
            return None
        box = support_box(known, limit / STRICTER, arms)
        field = _twin(known, tolerance, limit, arms, box)
        # With samples for STRONGER fields; their number is hardly greater, since errors fall with its fourth power.
        structure = MissedStructure(field, job.pilot, job.task.until, limit, arms, job.pilot)
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
        job = replace(job, task=replace(job.task, field=field, plan=plan), fixed_plan=plan, prepared=place.run)

        def another() -> ValuesInTurn:
            alike = replace(task, field=found.twin(field))
            return ValuesInTurn(alike, job.pilot).prepare(alike)

        found = cls(job, task, structure, limit, box, MemoryInTurn(place, another))
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
            task=replace(job.task, field=field, plan=plan),
            air=air,
            base=job,
            prepared=FollowedRun(self, field, plan),
            shared=[self],
            lock=threading.Lock(),
        )

    def _worst(self, field: IndexField, limit: float, pilots: list[dict[str, np.ndarray]]) -> float | None:
        """The pilot's greatest error [m] in a field whose tables are known; None where the plan does not hold."""
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


def _strength(grid: UniformGrid) -> float:
    """The greatest absolute contrast."""
    low, high = grid.extremes
    return max(-low, high)


def _wider_scales(made: list[dict[str, np.ndarray]], count: int, limit: float) -> tuple[float, float] | None:
    """Scales of a ray's error up to WIDER times those that the pilot needs, if they reject no ray of it."""
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
