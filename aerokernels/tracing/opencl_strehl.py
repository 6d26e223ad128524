"""The million-ray pupil on an OpenCL device: launch, trace and sums, nothing per ray coming back."""

import time
from types import SimpleNamespace

import numpy as np
import pyopencl as cl
from pyopencl.cltypes import make_double3

from .opencl_backend import RAY_BYTES, allocate, enqueue, launch_trace, prepare, to_device
from .opencl_devices import Session
from .opencl_program import WORK_GROUP, build
from .pupil_sums import MOMENT_COUNT, PUPIL_OUTPUTS, fit_plane, join_groups, moments_in_metres, replicate_seeds
from .scheme import GROUP

KERNELS = ("launch_pupil", "sum_moments", "sum_phasors")
# Bytes for a ray that stay on the device for the second sum: pupil coordinates, OPD and status.
KEPT_BYTES = 16 + 8 + 4


def reduce_pupil(field, pupil, look, until, plan, wavelength, per_replicate, replicates, seed, with_tilt):
    """Trace a pupil and sum: moments (replicates, MOMENT_COUNT), phasors (replicates,), evaluations, seconds.

    A replicate at a time is traced; what the phasors need of all of them stays on the device.

    Raises:
        OpenCLUnavailable: The device cannot be opened.
        ValueError: A field, or so many rays, that do not fit the device.
    """
    ready = prepare(field, plan, until, wavelength, PUPIL_OUTPUTS, look[None])
    opened = ready.session
    _check_memory(opened, per_replicate, replicates)
    start = time.perf_counter()
    # Kernel objects hold their arguments: these belong to this call.
    kernels = {name: cl.Kernel(build(opened, f"{name}.cl"), name) for name in KERNELS}
    compiled = time.perf_counter()
    batches = _trace_replicates(ready, kernels, pupil, look, per_replicate, replicate_seeds(seed, replicates))
    group_count = -(-per_replicate // GROUP)
    moments = np.stack([join_groups(_fetch(opened, b.moments, (group_count, MOMENT_COUNT))) for b in batches])
    plane = make_double3(*fit_plane(moments, with_tilt))
    for batch in batches:
        arguments = [np.float64(2.0 * np.pi / wavelength), plane, np.int32(per_replicate), np.int32(0)]
        arguments += [np.int32(group_count), batch.pupil, batch.opd, batch.status, batch.phasors]
        _enqueue_groups(opened, kernels["sum_phasors"], arguments, group_count)
    pairs = np.stack([_fetch(opened, batch.phasors, (group_count, 2)).sum(axis=0) for batch in batches])
    seconds = dict(ready.seconds)
    seconds["compile"] += compiled - start
    seconds["kernel"] = time.perf_counter() - compiled
    return moments_in_metres(moments, pupil), pairs @ [1.0, 1.0j], int(moments[:, 11].sum()), seconds


def _trace_replicates(ready, kernels, pupil, look, count: int, seeds: np.ndarray) -> list[SimpleNamespace]:
    """Start launch, trace and moments of every replicate, one after the other; they share what is not kept."""
    opened = ready.session
    position, direction = _empty(opened, 24 * count), _empty(opened, 24 * count)
    shared = allocate(opened, PUPIL_OUTPUTS - {"opd"}, count)
    axes = [make_double3(*(pupil.radius * axis)) for axis in pupil.axes]
    place = [make_double3(*pupil.center), *axes, make_double3(*look)]
    group_count = -(-count // GROUP)
    rays = np.int32(0), np.int32(count)
    batches = []
    # Before the first launch: a copy waits for all that was started before it.
    for pair in [to_device(opened, pair) for pair in seeds]:
        batch = SimpleNamespace(
            pupil=_empty(opened, 16 * count),
            opd=_empty(opened, 8 * count),
            status=_empty(opened, 4 * count),
            moments=_empty(opened, 8 * MOMENT_COUNT * group_count),
            phasors=_empty(opened, 16 * group_count),
        )
        launched = [*place, pair, np.int32(count), *rays, position, direction, batch.pupil]
        enqueue(opened, kernels["launch_pupil"], launched, count)
        results = {**shared, "opd": batch.opd, "status": batch.status}
        launch_trace(ready, position, direction, results, count)
        per_ray = [results[name] for name in ("opd", "step_error", "evaluation_count", "status")]
        summed = [np.int32(count), np.int32(0), np.int32(group_count), batch.pupil, *per_ray, batch.moments]
        _enqueue_groups(opened, kernels["sum_moments"], summed, group_count)
        batches.append(batch)
    return batches


def _enqueue_groups(opened: Session, kernel, arguments: list, group_count: int) -> None:
    """Start a summing kernel: a work-group for each group of rays."""
    enqueue(opened, kernel, arguments, group_count * WORK_GROUP)


def _empty(opened: Session, size: int):
    return cl.Buffer(opened.context, cl.mem_flags.READ_WRITE, size)


def _fetch(opened: Session, buffer, shape: tuple[int, int]) -> np.ndarray:
    values = np.empty(shape)
    cl.enqueue_copy(opened.queue, values, buffer, is_blocking=True)
    return values


def _check_memory(opened: Session, count: int, replicates: int) -> None:
    """Refuse rays that the device has no room for, before it fails half-way."""
    device = opened.device
    needed = count * (RAY_BYTES + replicates * KEPT_BYTES)
    if needed > device.global_mem_size or 24 * count > device.max_mem_alloc_size:
        raise ValueError(
            f"{replicates * count} rays take {needed / 2**30:.1f} GiB, and {24 * count / 2**30:.1f} GiB in one piece; "
            f"device {opened.name!r} has {device.global_mem_size / 2**30:.1f} GiB and gives "
            f"{device.max_mem_alloc_size / 2**30:.1f} GiB in one piece: use fewer rays, or another device"
        )
