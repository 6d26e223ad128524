"""The million-ray pupil on the device: launch, trace and sums, nothing per ray coming back."""

import functools
import time
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import warp as wp

from . import warp_pupil
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
from .warp_backend import allocate, launch, launch_trace, prepare
from .warp_pupil import join_sums, launch_pupil, sum_moments, sum_phasors


@functools.cache
def _load(device: str) -> None:
    wp.load_module(warp_pupil, device=device, block_dim=1 if device == "cpu" else None)


class PupilRun:
    """A pupil made ready on a device, to be traced any number of times.

    Some replicates at a time are traced. Phasors are summed at once but where the tilt, which all replicates decide,
    is taken out first: what they need then stays on the device.
    """

    def __init__(self, task: PupilTask):
        """Upload and compile what the task needs."""
        self.task, self.device = task, task.plan.device
        self.ready = prepare(task.field, task.plan, task.until, task.wavelength, PUPIL_OUTPUTS, task.look[None])
        start = time.perf_counter()
        _load(self.device)
        self.seconds = dict(self.ready.seconds)
        self.seconds["compile"] += time.perf_counter() - start
        self.batches = batches_of(task.replicates, task.per_replicate)
        pupil = task.pupil
        place = (pupil.center, *(pupil.radius * axis for axis in pupil.axes), task.look)
        self.place = [wp.vec3d(*vector) for vector in place]
        if task.fan is None:
            order = point_order(task.per_replicate, task.by_radius)
            self.order = wp.array(order, dtype=wp.int32, device=self.device)
            seeds = replicate_seeds(task.seed, task.replicates)
            self.seeds = [wp.array(seeds[rows], dtype=wp.uint32, device=self.device) for rows in self.batches]
        self.one = wp.ones(1, dtype=wp.float64, device=self.device)
        self.fan: SimpleNamespace | None = None  # that of one batch stays on the device

    def __call__(self) -> PupilSums:
        """Trace and sum."""
        task, seconds, start = self.task, self.seconds, time.perf_counter()
        self.seconds = dict.fromkeys(seconds, 0.0)  # what was made ready is ready the next time
        sums = np.empty((task.replicates, SUM_COUNT))
        kept, rejected = [], 0
        for number, rows in enumerate(self.batches):
            replicates = rows.stop - rows.start
            count = replicates * task.per_replicate
            rays = self._launch(number, rows, count)
            if self.ready.rough is not None:
                self.ready.rough.zero_()
            results = allocate(PUPIL_OUTPUTS, count, self.device)
            launch_trace(self.ready, rays.position, rays.direction, results, count, self.device)
            batch = SimpleNamespace(rows=rows, replicates=replicates, rays=rays, results=results)
            sums[rows] = self._sums(batch, np.zeros(3))
            unfit = self.ready.rough is not None and int(self.ready.rough.numpy()[0])
            if unfit or not holds_tolerance(sums[rows], task):
                rejected += self._retrace(rays, results)
                sums[rows] = self._sums(batch, np.zeros(3))
            if task.with_tilt:
                kept.append(batch)
        if task.with_tilt:
            plane = fit_plane(sums[:, :MOMENT_COUNT], True)
            for batch in kept:
                sums[batch.rows] = self._sums(batch, plane)
        moments = moments_in_metres(sums[:, :MOMENT_COUNT], task)
        phasors = sums[:, MOMENT_COUNT] + 1j * sums[:, MOMENT_COUNT + 1]
        seconds = {**seconds, "kernel": time.perf_counter() - start}
        return PupilSums(moments, phasors, seconds, task.replicates * task.per_replicate, rejected)

    def _launch(self, number: int, rows: slice, count: int) -> SimpleNamespace:
        """The rays of some replicates, on the device: start, direction, place on the pupil and weight."""
        task, device = self.task, self.device
        if task.fan is None:
            rays = SimpleNamespace(
                position=wp.empty(count, dtype=wp.vec3d, device=device),
                direction=wp.empty(count, dtype=wp.vec3d, device=device),
                pupil=wp.empty(count, dtype=wp.vec2d, device=device),
                weight=self.one,
                weight_count=1,
            )
            geometry = [*self.place, self.seeds[number], self.order, task.per_replicate]
            launch(launch_pupil, geometry, [rays.position, rays.direction, rays.pupil], count, device)
            return rays
        if self.fan is None or len(self.batches) > 1:
            kinds = (wp.vec3d, wp.vec3d, wp.vec2d, wp.float64)
            arrays = zip(fan_rays(task, rows), kinds, strict=True)
            position, direction, place, weight = (wp.array(array, dtype=k, device=device) for array, k in arrays)
            self.fan = SimpleNamespace(
                position=position, direction=direction, pupil=place, weight=weight, weight_count=count
            )
        return self.fan

    def _sums(self, batch: SimpleNamespace, plane: np.ndarray) -> np.ndarray:
        """Sums of the replicates of a batch, (n, SUM_COUNT)."""
        per_replicate, rays, results, device = self.task.per_replicate, batch.rays, batch.results, self.device
        groups = batch.replicates * group_count(per_replicate)
        sums = wp.empty(groups * SUM_COUNT, dtype=wp.float64, device=device)
        shared = [rays.weight_count, rays.weight, rays.pupil]
        per_ray = [results[name] for name in ("opd", "step_error", "evaluation_count", "status")]
        launch(sum_moments, [per_replicate], [*shared, *per_ray, sums], groups, device)
        numbers = [2.0 * np.pi / self.task.wavelength, wp.vec3d(*plane), per_replicate]
        launch(sum_phasors, numbers, [*shared, results["opd"], results["status"], sums], groups, device)
        for rows, joined in pairwise(joined_counts(per_replicate)):
            sum_count = batch.replicates * joined * SUM_COUNT
            whole = wp.empty(sum_count, dtype=wp.float64, device=device)
            launch(join_sums, [rows, joined], [sums, whole], sum_count, device)
            sums = whole
        return sums.numpy().reshape(batch.replicates, SUM_COUNT)

    def _retrace(self, rays: SimpleNamespace, results: dict) -> int:
        """Trace again the rays of a batch that are above the tolerance; returns how many are so still."""
        task = self.task
        names = ("opd", "step_error", "status", "evaluation_count")
        arrays = {name: np.array(results[name].numpy()) for name in names}
        position, direction = rays.position.numpy(), rays.direction.numpy()
        retrace_rejected(task.field, position, direction, task.plan, task.until, task.wavelength, arrays)
        for name, array in arrays.items():
            results[name].assign(array)
        return int(np.count_nonzero(arrays["status"] == RayStatus.TOLERANCE_NOT_MET))
