"""The million-ray pupil on an OpenCL device: launch, trace and sums, nothing per ray coming back."""

import time
from types import SimpleNamespace

import numpy as np
import pyopencl as cl
from pyopencl.cltypes import make_double3

from .even import mend_rough
from .opencl_backend import RAY_BYTES, allocate, enqueue, launch_trace, prepare, rough_count, to_device
from .opencl_devices import Session
from .opencl_program import WORK_GROUP, build
from .pupil_sums import (
    MOMENT_COUNT,
    PUPIL_OUTPUTS,
    batches_of,
    fit_plane,
    group_count,
    join_groups,
    moments_in_metres,
    point_order,
    replicate_seeds,
)

KERNELS = ("launch_pupil", "sum_moments", "sum_phasors")
# Bytes for a ray that stay on the device for the second sum: pupil coordinates, OPD and status.
KEPT_BYTES = 16 + 8 + 4


def reduce_pupil(
    field, pupil, look, until, plan, wavelength, per_replicate, replicates, seed, with_tilt, by_radius=False
):
    """Trace a pupil and sum: moments (replicates, MOMENT_COUNT), phasors (replicates,), evaluations, seconds.

    Some replicates at a time are traced. Phasors are summed at once but where the tilt, which all replicates decide,
    is taken out first: what they need then stays on the device.

    Raises:
        OpenCLUnavailable: The device cannot be opened.
        ValueError: A field, or so many rays, that do not fit the device.
    """
    ready = prepare(field, plan, until, wavelength, PUPIL_OUTPUTS, look[None])
    opened = ready.session
    start = time.perf_counter()
    # Kernel objects hold their arguments: these belong to this call.
    kernels = {name: cl.Kernel(build(opened, f"{name}.cl"), name) for name in KERNELS}
    compiled = time.perf_counter()
    batches = batches_of(replicates, per_replicate)
    widest = batches[0].stop - batches[0].start
    together = widest * per_replicate
    _check_memory(opened, together, replicates * per_replicate if with_tilt else together)
    place = [make_double3(*vector) for vector in (pupil.center, *(pupil.radius * axis for axis in pupil.axes), look)]
    order = to_device(opened, point_order(per_replicate, by_radius))
    seeds = replicate_seeds(seed, replicates)
    scratch = None
    summed = []
    for rows in batches:
        if scratch is None or with_tilt:
            scratch = _buffers(opened, together, widest * group_count(per_replicate), scratch)
        count = rows.stop - rows.start
        _launch(opened, kernels, [*place, to_device(opened, seeds[rows]), order], per_replicate, count, scratch)
        results = scratch.results
        before = rough_count(ready) if rows.start else 0
        launch_trace(ready, scratch.position, scratch.direction, results, count * per_replicate)
        sums = _Sums(opened, kernels, per_replicate, count, scratch, wavelength)
        sums.enqueue_moments()
        if not with_tilt:
            sums.enqueue_phasors(np.zeros(3))
        if rough_count(ready) > before:
            _mend(field, plan, until, wavelength, opened, scratch, count * per_replicate)
            sums.enqueue_moments()
            if not with_tilt:
                sums.enqueue_phasors(np.zeros(3))
        summed.append(sums)
        sums.moments = sums.fetch_moments()
        if not with_tilt:
            sums.phasors = sums.fetch_phasors()
    moments = np.concatenate([sums.moments for sums in summed])
    if with_tilt:
        plane = fit_plane(moments, with_tilt)
        for sums in summed:
            sums.enqueue_phasors(plane)
            sums.phasors = sums.fetch_phasors()
    phasors = np.concatenate([sums.phasors for sums in summed])
    seconds = dict(ready.seconds)
    seconds["compile"] += compiled - start
    seconds["kernel"] = time.perf_counter() - compiled
    return moments_in_metres(moments, pupil), phasors, int(moments[:, 11].sum()), seconds


def _buffers(opened: Session, rays: int, groups: int, before: SimpleNamespace | None) -> SimpleNamespace:
    """Buffers of a batch; what the second sum does not need is taken over from the batch before."""
    if before is None:
        position, direction = _empty(opened, 24 * rays), _empty(opened, 24 * rays)
        shared = allocate(opened, PUPIL_OUTPUTS, rays)
    else:
        position, direction, shared = before.position, before.direction, before.results
    fresh = {} if before is None else {"opd": _empty(opened, 8 * rays), "status": _empty(opened, 4 * rays)}
    return SimpleNamespace(
        position=position,
        direction=direction,
        pupil=_empty(opened, 16 * rays),
        results={**shared, **fresh},
        moments=_empty(opened, 8 * MOMENT_COUNT * groups),
        phasors=_empty(opened, 16 * groups),
    )


def _launch(opened: Session, kernels, arguments: list, per_replicate: int, replicates: int, scratch) -> None:
    """Start the rays of some replicates."""
    count = replicates * per_replicate
    ends = [np.int32(per_replicate), np.int32(0), np.int32(count)]
    enqueue(
        opened, kernels["launch_pupil"], [*arguments, *ends, scratch.position, scratch.direction, scratch.pupil], count
    )


class _Sums:
    """The sums of some replicates, whose rays are in `scratch`."""

    moments: np.ndarray
    phasors: np.ndarray

    def __init__(self, opened: Session, kernels, per_replicate: int, replicates: int, scratch, wavelength: float):
        self.opened, self.kernels, self.scratch = opened, kernels, scratch
        self.per_replicate = per_replicate
        self.groups = replicates * group_count(per_replicate)
        self.wave_number = 2.0 * np.pi / wavelength

    def enqueue_moments(self) -> None:
        results = self.scratch.results
        per_ray = [results[name] for name in ("opd", "step_error", "evaluation_count", "status")]
        self._enqueue("sum_moments", [], [self.scratch.pupil, *per_ray, self.scratch.moments])

    def enqueue_phasors(self, plane: np.ndarray) -> None:
        results = self.scratch.results
        per_ray = [self.scratch.pupil, results["opd"], results["status"], self.scratch.phasors]
        self._enqueue("sum_phasors", [np.float64(self.wave_number), make_double3(*plane)], per_ray)

    def _enqueue(self, name: str, numbers: list, arrays: list) -> None:
        """Start a summing kernel: a work-group for each group of rays."""
        ends = [np.int32(self.per_replicate), np.int32(0), np.int32(self.groups)]
        enqueue(self.opened, self.kernels[name], [*numbers, *ends, *arrays], self.groups * WORK_GROUP)

    def fetch_moments(self) -> np.ndarray:
        """Moments of the replicates, (n, MOMENT_COUNT)."""
        return join_groups(_fetch(self.opened, self.scratch.moments, (self.groups, MOMENT_COUNT)), self.per_replicate)

    def fetch_phasors(self) -> np.ndarray:
        """Phasors of the replicates, (n,)."""
        pairs = _fetch(self.opened, self.scratch.phasors, (self.groups, 2)) @ [1.0, 1.0j]
        return pairs.reshape(-1, group_count(self.per_replicate)).sum(axis=1)


def _mend(field, plan, until, wavelength: float, opened: Session, scratch, count: int) -> None:
    """Trace again the rays of a batch that even samples do not hold for."""
    arrays = {name: np.empty(count) for name in ("opd", "step_error")}
    arrays |= {name: np.empty(count, np.int32) for name in ("status", "evaluation_count")}
    position, direction = np.empty((count, 3)), np.empty((count, 3))
    for name, array in arrays.items():
        cl.enqueue_copy(opened.queue, array, scratch.results[name], is_blocking=True)
    cl.enqueue_copy(opened.queue, position, scratch.position, is_blocking=True)
    cl.enqueue_copy(opened.queue, direction, scratch.direction, is_blocking=True)
    mend_rough(field, position, direction, plan, until, wavelength, arrays)
    for name, array in arrays.items():
        cl.enqueue_copy(opened.queue, scratch.results[name], array, is_blocking=True)


def _empty(opened: Session, size: int):
    return cl.Buffer(opened.context, cl.mem_flags.READ_WRITE, size)


def _fetch(opened: Session, buffer, shape: tuple[int, int]) -> np.ndarray:
    values = np.empty(shape)
    cl.enqueue_copy(opened.queue, values, buffer, is_blocking=True)
    return values


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
