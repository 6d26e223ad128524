"""The million-ray pupil on an OpenCL device: launch, trace and sums, nothing per ray coming back."""

import time
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pyopencl as cl
from pyopencl.cltypes import make_double3

from .opencl_backend import RAY_BYTES, allocate, enqueue, launch_trace, prepare, to_device, whole_size
from .opencl_devices import Session
from .opencl_program import WORK_GROUP, build
from .pupil_sums import (
    MOMENT_COUNT,
    PUPIL_OUTPUTS,
    SUM_COUNT,
    PupilSums,
    PupilTask,
    batches_of,
    fan_rays,
    fit_plane,
    group_count,
    holds_tolerance,
    joined_counts,
    moments_in_metres,
    point_order,
    replicate_seeds,
)
from .retrace import retrace_rejected
from .status import RayStatus

KERNELS = ("launch_pupil", "sum_moments", "sum_phasors", "join_sums")
# Bytes for a ray that stay on the device for the second sum: pupil coordinates, OPD and status.
KEPT_BYTES = 16 + 8 + 4


class PupilRun:
    """A pupil made ready on a device, to be traced any number of times.

    Some replicates at a time are traced. Phasors are summed at once but where the tilt, which all replicates decide,
    is taken out first: what they need then stays on the device.

    Raises:
        OpenCLUnavailable: The device cannot be opened.
        ValueError: A field, or so many rays, that do not fit the device.
    """

    def __init__(self, task: PupilTask):
        """Upload and compile what the task needs."""
        self.task = task
        self.ready = prepare(task.field, task.plan, task.until, task.wavelength, PUPIL_OUTPUTS, task.look[None])
        self.opened = self.ready.session
        self.batches = batches_of(task.replicates, task.per_replicate)
        self.widest = self.batches[0].stop - self.batches[0].start
        together = self.widest * task.per_replicate
        _check_memory(self.opened, together, task.replicates * task.per_replicate if task.with_tilt else together)
        start = time.perf_counter()
        # Kernel objects hold their arguments: these belong to this run.
        programs = {name: build(self.opened, f"{name}.cl") for name in KERNELS}
        self.kernels = {name: cl.Kernel(program, name) for name, program in programs.items()}
        levels = len(joined_counts(task.per_replicate)) - 1
        self.joiners = [cl.Kernel(programs["join_sums"], "join_sums") for _ in range(levels)]
        self.seconds = dict(self.ready.seconds)
        self.seconds["compile"] += time.perf_counter() - start
        pupil = task.pupil
        place = (pupil.center, *(pupil.radius * axis for axis in pupil.axes), task.look)
        self.place = [make_double3(*vector) for vector in place]
        if task.fan is None:
            self.order = to_device(self.opened, point_order(task.per_replicate, task.by_radius))
            seeds = replicate_seeds(task.seed, task.replicates)
            self.seeds = [to_device(self.opened, seeds[rows]) for rows in self.batches]
        self.rejected = 0  # rays above the tolerance still
        self.one = to_device(self.opened, np.ones(1))
        self.fan: SimpleNamespace | None = None  # that of one batch stays on the device
        # The only batch and the launches that it takes, whose kernels keep their arguments: they are started again.
        self.again: tuple[SimpleNamespace, list[tuple]] | None = None

    def __call__(self) -> PupilSums:
        """Trace and sum."""
        task, seconds, start = self.task, self.seconds, time.perf_counter()
        self.seconds = dict.fromkeys(seconds, 0.0)  # what was made ready is ready the next time
        self.rejected = 0
        sums = self._sums_again()
        if sums is None:
            sums = self._sums_of_batches()
        moments = moments_in_metres(sums[:, :MOMENT_COUNT], task)
        phasors = sums[:, MOMENT_COUNT] + 1j * sums[:, MOMENT_COUNT + 1]
        seconds["kernel"] = time.perf_counter() - start
        return PupilSums(moments, phasors, seconds, task.replicates * task.per_replicate, self.rejected)

    def _sums_again(self) -> np.ndarray | None:
        """As the last time, by the same launches; None where there is no last time or its buffers are gone."""
        if self.again is None or getattr(self.opened.scratch, "pupil", None) is not self.again[0].scratch:
            return None
        batch, launches = self.again
        for kernel, size in launches:
            cl.enqueue_nd_range_kernel(self.opened.queue, kernel, size, (WORK_GROUP,))
        return self._fetch_retraced(batch)

    def _sums_of_batches(self) -> np.ndarray:
        """Sums of all replicates, (replicates, SUM_COUNT)."""
        task = self.task
        scratch = None
        sums = np.empty((task.replicates, SUM_COUNT))
        kept = []
        for number, rows in enumerate(self.batches):
            replicates = rows.stop - rows.start
            count = replicates * task.per_replicate
            if scratch is None or task.with_tilt:
                scratch = self._buffers(scratch)
            rays = self._launch(number, rows, count, scratch)
            launch_trace(self.ready, rays.position, rays.direction, scratch.results, count)
            batch = SimpleNamespace(rows=rows, replicates=replicates, rays=rays, scratch=scratch)
            self._sum(batch, np.zeros(3))
            sums[rows] = self._fetch_retraced(batch)
            kept.append(batch)
        if task.with_tilt:
            plane = fit_plane(sums[:, :MOMENT_COUNT], True)
            for batch in kept:
                self._sum(batch, plane)
                sums[batch.rows], _ = self._fetch(batch)
        elif len(kept) == 1:
            self.again = kept[0], self._launches(kept[0])
        return sums

    def _launches(self, batch: SimpleNamespace) -> list[tuple]:
        """Kernels and sizes of what a batch takes, in their order."""
        per_replicate, lanes = self.task.per_replicate, self.ready.lanes
        count = batch.replicates * per_replicate
        groups = batch.replicates * group_count(per_replicate) * WORK_GROUP
        launches = [(self.kernels["launch_pupil"], whole_size(count))] if self.task.fan is None else []
        launches.append((self.ready.kernel, whole_size(-(-count // lanes))))
        launches += [(self.kernels[name], whole_size(groups)) for name in ("sum_moments", "sum_phasors")]
        joined = joined_counts(per_replicate)[1:]
        sizes = [whole_size(batch.replicates * rows * SUM_COUNT) for rows in joined]
        return [*launches, *zip(self.joiners, sizes, strict=True)]

    def _fetch_retraced(self, batch: SimpleNamespace) -> np.ndarray:
        """Sums of the replicates of a batch, after rays above the tolerance were traced again."""
        sums, unfit = self._fetch(batch)
        if unfit or not holds_tolerance(sums, self.task):
            self.rejected += self._retrace(batch.rays, batch.scratch, batch.replicates * self.task.per_replicate)
            self._sum(batch, np.zeros(3))
            sums, _ = self._fetch(batch)
        return sums

    def _buffers(self, before: SimpleNamespace | None) -> SimpleNamespace:
        """Buffers of a batch; what the second sum does not need is taken over from the batch before."""
        opened, rays = self.opened, self.widest * self.task.per_replicate
        groups = self.widest * group_count(self.task.per_replicate)
        last = getattr(opened.scratch, "pupil", None)
        if before is None and last is not None and last.size == (rays, groups):
            return last
        if before is None:
            opened.scratch.pupil = last = None  # let it go before as much is asked for again
            position, direction = _empty(opened, 24 * rays), _empty(opened, 24 * rays)
            shared = allocate(opened, PUPIL_OUTPUTS, rays)
        else:
            position, direction, shared = before.position, before.direction, before.results
        fresh = {} if before is None else {"opd": _empty(opened, 8 * rays), "status": _empty(opened, 4 * rays)}
        scratch = SimpleNamespace(
            size=(rays, groups),
            position=position,
            direction=direction,
            pupil=_empty(opened, 16 * rays),
            results={**shared, **fresh},
            sums=[
                _empty(opened, 8 * SUM_COUNT * self.widest * rows) for rows in joined_counts(self.task.per_replicate)
            ],
        )
        if before is None and not self.task.with_tilt:
            opened.scratch.pupil = scratch
        return scratch

    def _launch(self, number: int, rows: slice, count: int, scratch) -> SimpleNamespace:
        """The rays of some replicates, on the device: start, direction, place on the pupil and weight."""
        task, opened = self.task, self.opened
        if task.fan is None:
            ends = [np.int32(task.per_replicate), np.int32(0), np.int32(count)]
            arrays = [scratch.position, scratch.direction, scratch.pupil]
            enqueue(
                opened,
                self.kernels["launch_pupil"],
                [*self.place, self.seeds[number], self.order, *ends, *arrays],
                count,
            )
            return SimpleNamespace(
                position=scratch.position,
                direction=scratch.direction,
                pupil=scratch.pupil,
                weight=self.one,
                weight_count=1,
            )
        if self.fan is None or len(self.batches) > 1:
            position, direction, place, weight = (to_device(opened, array) for array in fan_rays(task, rows))
            self.fan = SimpleNamespace(
                position=position, direction=direction, pupil=place, weight=weight, weight_count=count
            )
        return self.fan

    def _sum(self, batch: SimpleNamespace, plane: np.ndarray) -> None:
        """Start the sums of a batch: of groups, a work-group each, then of replicates."""
        per_replicate, rays, results = self.task.per_replicate, batch.rays, batch.scratch.results
        groups = batch.replicates * group_count(per_replicate)
        shared = [np.int32(per_replicate), np.int32(0), np.int32(groups), np.int32(rays.weight_count), rays.weight]
        shared.append(rays.pupil)
        per_ray = [results[name] for name in ("opd", "step_error", "evaluation_count", "status")]
        sums = batch.scratch.sums
        arguments = [*shared, *per_ray, sums[0]]
        enqueue(self.opened, self.kernels["sum_moments"], arguments, groups * WORK_GROUP)
        numbers = [np.float64(2.0 * np.pi / self.task.wavelength), make_double3(*plane)]
        arguments = [*numbers, *shared, results["opd"], results["status"], sums[0]]
        enqueue(self.opened, self.kernels["sum_phasors"], arguments, groups * WORK_GROUP)
        counts = joined_counts(per_replicate)
        for level, (rows, joined) in enumerate(pairwise(counts)):
            sum_count = batch.replicates * joined * SUM_COUNT
            arguments = [np.int32(rows), np.int32(joined), np.int32(0), np.int32(sum_count), *sums[level : level + 2]]
            enqueue(self.opened, self.joiners[level], arguments, sum_count)

    def _fetch(self, batch: SimpleNamespace) -> tuple[np.ndarray, int]:
        """Sums of the replicates of a batch, (n, SUM_COUNT), and how many rays even samples do not hold for."""
        values, queue = np.empty((batch.replicates, SUM_COUNT)), self.opened.queue
        if self.ready.rough is None:
            cl.enqueue_copy(queue, values, batch.scratch.sums[-1], is_blocking=True)
            return values, 0
        rough = np.zeros(1, np.int32)
        # The device is waited for once: copies end in their order.
        first = cl.enqueue_copy(queue, rough, self.ready.rough, is_blocking=False)
        cl.enqueue_copy(queue, values, batch.scratch.sums[-1], is_blocking=True)
        first.wait()
        if rough[0]:
            cl.enqueue_copy(queue, self.ready.rough, np.zeros(1, np.int32), is_blocking=True)
        return values, int(rough[0])

    def _retrace(self, rays: SimpleNamespace, scratch: SimpleNamespace, count: int) -> int:
        """Trace again the rays of a batch that are above the tolerance; returns how many are so still."""
        task, queue = self.task, self.opened.queue
        arrays: dict[str, np.ndarray] = {name: np.empty(count) for name in ("opd", "step_error")}
        arrays |= {name: np.empty(count, np.int32) for name in ("status", "evaluation_count")}
        position, direction = np.empty((count, 3)), np.empty((count, 3))
        for name, array in arrays.items():
            cl.enqueue_copy(queue, array, scratch.results[name], is_blocking=True)
        cl.enqueue_copy(queue, position, rays.position, is_blocking=True)
        cl.enqueue_copy(queue, direction, rays.direction, is_blocking=True)
        retrace_rejected(task.field, position, direction, task.plan, task.until, task.wavelength, arrays)
        for name, array in arrays.items():
            cl.enqueue_copy(queue, scratch.results[name], array, is_blocking=True)
        return int(np.count_nonzero(arrays["status"] == RayStatus.TOLERANCE_NOT_MET))


def _empty(opened: Session, size: int):
    return cl.Buffer(opened.context, cl.mem_flags.READ_WRITE, size)


def _check_memory(opened: Session, together: int, kept: int) -> None:
    """Refuse rays that the device has no room for, before it fails half-way."""
    device = opened.device
    needed = together * RAY_BYTES + kept * KEPT_BYTES
    if needed > device.global_mem_size or 24 * together > device.max_mem_alloc_size:
        raise ValueError(
            f"rays of a pupil take {needed / 2**30:.1f} GiB, and {24 * together / 2**30:.1f} GiB in one piece; "
            f"device {opened.name!r} has {device.global_mem_size / 2**30:.1f} GiB and gives "
            f"{device.max_mem_alloc_size / 2**30:.1f} GiB in one piece: use fewer rays, or another device"
        )
