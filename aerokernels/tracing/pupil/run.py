"""Run a pupil of millions of rays on an engine: make, trace and sum the rays there, without downloading any."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from aerokernels.tracing.tasks.quadrature import lattice_order, radial_points, smoothed_axes
from aerokernels.tracing.tasks.sums import (
    MOMENT_COUNT,
    PUPIL_OUTPUTS,
    SUM_COUNT,
    PupilSums,
    PupilTask,
    batches_of,
    fit_surface,
    group_count,
    holds_tolerance,
    joined_counts,
    moments_in_metres,
    point_order,
    radial_rays,
)

from ...derived import cached_on
from ...display.progress import tracked
from ...process.clock import stage
from ...pupils import Pupil, across_look
from ...rays import RayBundle
from ..absorption import absorbs, amplitudes
from ..engines import OUTPUT_TYPES, Engine, engine_of
from ..engines.info import memory_of
from ..launch import RAY_BYTES, retrace_rejected
from ..stop import RayStatus


@dataclass(eq=False)
class Batch:
    """Some replicates (`rows`) with their rays and outputs on the device; one weight for all rays, or one for each."""

    rows: slice
    count: int
    position: Any
    direction: Any
    place: Any
    weight: Any
    weight_count: int
    results: dict[str, Any]


class PupilRun:
    """A pupil prepared on a device, to be traced in batches of replicates, each time with points of another seed.

    To remove tilt or focus all replicates must be fitted, so their OPD stays on the device for the phasor sums.
    """

    def __init__(self, task: PupilTask):
        """Upload and compile everything that the task needs."""
        self.task = task
        self.engine = engine = engine_of(task.plan.backend, task.plan.device)
        self.prepared = engine.prepare(
            task.field, task.plan, task.until, task.wavelength, PUPIL_OUTPUTS, task.look[None]
        )
        self.batches = batches_of(task.replicates, task.per_replicate)
        self.widest = self.batches[0].stop - self.batches[0].start
        together = self.widest * task.per_replicate
        kept = task.replicates * task.per_replicate if task.terms else together
        check_memory(engine.device, engine.memory, together, kept)
        needed = ("sum_rays", "reduce_sums")  # rays along a radius are made on the host
        self.kernels = engine.kernels(needed if task.is_radial else ("launch_pupil", *needed))
        with stage("upload"):
            self.one = engine.put(np.ones(1))
            self.seeds = None if task.is_radial else engine.sent(np.zeros(2 * self.widest, np.uint32))
            self.starts = None if self.seeds is None else self._starts(self.seeds.buffer)
            self.headings = None
            if task.is_radial:
                self.headings = engine.put(np.repeat(task.look[None], together, axis=0))
        self.no_surface = self._phasor_numbers(np.zeros(4))
        *joined, _ = joined_counts(task.per_replicate)
        self.sums = [engine.empty(SUM_COUNT * self.widest * rows) for rows in joined]
        arrays = [np.zeros(self.widest * SUM_COUNT)]
        if self.prepared.rejected is not None:
            arrays.append(np.zeros(1, np.int32))
        self.reading = engine.fetched(arrays)
        self.found = self.reading.arrays[0].reshape(-1, SUM_COUNT)
        self.rejected = None if self.prepared.rejected is None else self.reading.arrays[1]
        self.sums.append(self.reading.buffers[0])
        if self.prepared.rejected is not None:
            self.prepared.rejected = self.reading.buffers[1]
            if engine.is_gpu:  # on a CPU the buffer is the array
                engine.clear(self.prepared.rejected)
        # A single batch, whose rays are made on the device, repeats the same launches for each seed.
        repeats = len(self.batches) == 1 and not task.is_radial and not absorbs(task.field)
        self.repeat = engine.recorded() if repeats else None
        self.buffers: list[dict[str, Any]] = []  # of each batch whose rays are still needed
        self.made: list[Batch] = []  # the batches whose rays are made on the device

    def _starts(self, seeds: Any) -> list:
        """Arguments of the kernel launch_pupil ahead of the rays, including the seeds of a batch."""
        task, pupil = self.task, self.task.pupil
        of_square = pupil.square_map
        vectors = [pupil.center, *(pupil.reach * axis for axis in pupil.axes), task.look]
        vectors += [np.append(row, 0.0) for row in across_look(pupil, task.look)]
        shape = [of_square.shape, of_square.row_count, of_square.column_count, self.engine.put(of_square.table)]
        make = lattice_order if task.generator else point_order
        order = _order(task.field.samples.places, self.engine, make, task.per_replicate, task.by_radius)
        return [*vectors, *shape, seeds, order, task.per_replicate, task.generator, smoothed_axes(of_square)]

    def __call__(self, seed: int | None) -> PupilSums:
        """Trace and sum the points of a seed."""
        with stage("kernel"), memory_of(self.task.plan.device):
            return self._run(seed)

    def _run(self, seed: int | None) -> PupilSums:
        task = self.task
        kept, parts, rejected = [], [], 0
        points = None if task.is_radial else task.points(seed)
        for number, rows in enumerate(tracked("rays", self.batches)):
            batch = self._place(number, rows, seed, points)
            if self.repeat is None:
                self._trace(batch)
            else:
                self.repeat(partial(self._trace, batch))
            self.reading.wait()
            found = self.found[: rows.stop - rows.start]
            has_rejected = self.rejected is not None and self.prepared.taken(int(self.rejected[0])) > 0
            if has_rejected or not holds_tolerance(found, task):
                rejected += self._retrace(batch)
                found = self._sums(batch, self.no_surface)
            parts.append(found if len(self.batches) == 1 else found.copy())  # the next batch overwrites it
            kept.append(batch)
        sums = parts[0] if len(parts) == 1 else np.concatenate(parts)
        if task.terms:
            numbers = self._phasor_numbers(fit_surface(sums[:, :MOMENT_COUNT], task.terms))
            for batch in kept:  # batches share the memory of errors and counts, which would now be those of the last
                sums[batch.rows, MOMENT_COUNT:] = self._sums(batch, numbers)[:, MOMENT_COUNT:]
        in_metres = moments_in_metres(sums, task)
        phasors = in_metres[:, MOMENT_COUNT:].view(np.complex128)[:, 0]
        return PupilSums(in_metres[:, :MOMENT_COUNT], phasors, task.replicates * task.per_replicate, rejected)

    def _buffers(self, number: int) -> dict[str, Any]:
        """Buffers of a batch: later batches own only those that the second sum needs."""
        engine, task = self.engine, self.task
        rays = self.widest * task.per_replicate
        if number == len(self.buffers):
            fresh = {"place": engine.empty(rays, 2)}
            if task.generator:
                fresh["weight"] = engine.empty(rays)
            if not number:
                fresh |= {name: engine.empty(rays, 3) for name in ("start", "heading")} | self.prepared.allocate(rays)
            fresh |= {name: engine.empty(rays, *OUTPUT_TYPES[name]) for name in ("opd", "status") if number}
            self.buffers.append({**(self.buffers[0] if number else {}), **fresh})
        return self.buffers[number]

    def _place(self, number: int, rows: slice, seed: int | None, points: Any) -> Batch:
        """Make a batch: upload the rays along a radius, or the seeds from which other rays are made on the device."""
        task = self.task
        if self.seeds is not None:
            self.seeds.array[: 2 * (rows.stop - rows.start)] = points[rows].ravel()
            if number < len(self.made):
                return self.made[number]
        count = (rows.stop - rows.start) * task.per_replicate
        buffers = self._buffers(number if task.terms else 0)
        results = {name: buffers[name] for name in OUTPUT_TYPES}
        if self.seeds is None:
            radial = _radial if seed is not None else _radial.function
            given = self.engine, task.pupil, task.per_replicate, task.replicates, seed, rows
            position, place, weight = radial(task.field.samples.places, *given)
            return Batch(rows, count, position, self.headings, place, weight, count, results)
        position, direction, place = (buffers[name] for name in ("start", "heading", "place"))
        weight, weights = (buffers["weight"], count) if task.generator else (self.one, 1)
        self.made.append(Batch(rows, count, position, direction, place, weight, weights, results))
        return self.made[number]

    def _trace(self, batch: Batch) -> None:
        """Start all launches of a batch, including the copy of its sums to the host."""
        if self.seeds is not None:
            assert self.starts is not None
            self.seeds.send()
            rays = [batch.position, batch.direction, batch.place, batch.weight]
            self.engine.launch(self.kernels["launch_pupil"], self.starts, rays, batch.count)
        if absorbs(self.task.field):
            self._weaken(batch)
        self.prepared.launch([batch.position, batch.direction], batch.results, batch.count)
        self._start_sums(batch, self.no_surface)
        self.reading.start()

    def _weaken(self, batch: Batch) -> None:
        """Weight the rays of a batch by the amplitude that the gas does not absorb."""
        task, count = self.task, batch.count
        weight = np.ones(count)
        if task.generator or task.is_radial:
            self.engine.get(batch.weight, weight)
        position, direction = np.empty((count, 3)), np.empty((count, 3))
        self.engine.get(batch.position, position)
        self.engine.get(batch.direction, direction)
        passed = amplitudes(task.field, RayBundle(position, direction), task.plan, task.until, task.wavelength)
        batch.weight, batch.weight_count = self.engine.put(weight * passed), count

    def _phasor_numbers(self, surface: np.ndarray) -> list:
        """First arguments of the kernel sum_rays; arguments that are the same objects need not be set again."""
        return [2.0 * np.pi / self.task.wavelength, surface[:3], float(surface[3]), self.task.per_replicate]

    def _sums(self, batch: Batch, numbers: list) -> np.ndarray:
        """Sums of the replicates of a batch, (n, SUM_COUNT), valid until the next; `numbers` as for `_start_sums`."""
        self._start_sums(batch, numbers)
        self.reading.start()
        self.reading.wait()
        return self.found[: batch.rows.stop - batch.rows.start]

    def _start_sums(self, batch: Batch, numbers: list) -> None:
        """Sum groups of the replicates of a batch, then groups of groups."""
        per_replicate, engine, results = self.task.per_replicate, self.engine, batch.results
        replicates = batch.rows.stop - batch.rows.start
        groups = replicates * group_count(per_replicate)
        per_ray = [results[name] for name in ("opd", "step_error", "evaluation_count", "status")]
        given = [batch.weight_count, batch.weight, batch.place, *per_ray, self.sums[0]]
        engine.launch(self.kernels["sum_rays"], numbers, given, groups)
        for (rows, joined), sums in zip(pairwise(joined_counts(per_replicate)), pairwise(self.sums), strict=True):
            engine.launch(self.kernels["reduce_sums"], [rows, joined], [*sums], replicates * joined * SUM_COUNT)

    def _retrace(self, batch: Batch) -> int:
        """Trace again the rays of a batch that are above the tolerance; return the number that still are."""
        task, engine = self.task, self.engine
        arrays: dict[str, np.ndarray] = {}
        for name in ("opd", "step_error", "status", "evaluation_count"):
            arrays[name] = np.empty(batch.count, OUTPUT_TYPES[name][1])
            engine.get(batch.results[name], arrays[name])
        position, direction = np.empty((batch.count, 3)), np.empty((batch.count, 3))
        engine.get(batch.position, position)
        engine.get(batch.direction, direction)
        rays = RayBundle(position, direction)
        retrace_rejected(task.field, rays, task.plan, task.until, task.wavelength, arrays)
        for name, array in arrays.items():
            engine.put_into(batch.results[name], array)
        return int(np.count_nonzero(arrays["status"] == RayStatus.TOLERANCE_NOT_MET))


@cached_on("places", 8)
def _radial(
    places: Any, engine: Engine, pupil: Pupil, per_replicate: int, replicates: int, seed: int | None, rows: slice
) -> list[Any]:
    """Positions, pupil coordinates and weights of rays along a radius on a device, shared with fields on the nodes."""
    return [engine.put(array) for array in radial_rays(pupil, radial_points(per_replicate, replicates, seed), rows)]


@cached_on("places", 8)
def _order(places: Any, engine: Engine, make: Callable[..., np.ndarray], count: int, by_radius: bool) -> Any:
    """The order of points on a device, shared with other fields on the nodes: it is never written to."""
    return engine.put(make(count, by_radius))


def check_memory(device: str, memory: tuple[float, float], together: int, kept: int) -> None:
    """Reject more rays than the device has memory for, before any is traced; `memory` is an Engine's."""
    whole, piece = memory
    # Bytes of a ray that stay on the device for the second sum: pupil coordinates, OPD and status.
    needed = together * RAY_BYTES + kept * (16 + 8 + 4)
    if needed > whole or 24 * together > piece:
        raise ValueError(
            f"rays of a pupil take {needed / 2**30:.1f} GiB, and {24 * together / 2**30:.1f} GiB in one piece; "
            f"device {device!r} has {whole / 2**30:.1f} GiB and gives {piece / 2**30:.1f} GiB in one piece: use fewer "
            "rays, or another device"
        )
