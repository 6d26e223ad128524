"""The million-ray pupil on the device: launch, trace and sums, nothing per ray coming back."""

import functools
import time
from types import SimpleNamespace

import numpy as np
import warp as wp

from . import warp_pupil
from .pupil_sums import MOMENT_COUNT, PUPIL_OUTPUTS, fit_plane, join_groups, moments_in_metres, replicate_seeds
from .scheme import GROUP
from .warp_backend import allocate, launch, prepare
from .warp_pupil import launch_pupil, sum_moments, sum_phasors


@functools.cache
def _load(device: str) -> None:
    wp.load_module(warp_pupil, device=device, block_dim=1 if device == "cpu" else None)


def reduce_pupil(field, pupil, look, until, plan, wavelength, per_replicate, replicates, seed, with_tilt):
    """Trace a pupil and sum: moments (replicates, MOMENT_COUNT), phasors (replicates,), evaluations, seconds.

    Each replicate is padded to whole groups of rays, so that a group never straddles two.
    """
    ready = prepare(field, plan, until, wavelength, PUPIL_OUTPUTS, look[None])
    start = time.perf_counter()
    _load(plan.device)
    ready.seconds["compile"] += time.perf_counter() - start
    start = time.perf_counter()
    device = plan.device
    seeds = [wp.array(pair[None], dtype=wp.uint32, device=device) for pair in replicate_seeds(seed, replicates)]
    axes = [pupil.radius * axis for axis in pupil.axes]
    # Nothing is fetched before all replicates are on their way: a GPU works on several at a time.
    batches = [_trace_replicate(ready, pupil, axes, look, pair, per_replicate, device) for pair in seeds]
    moments = np.stack([join_groups(batch.moments.numpy()) for batch in batches])
    plane = wp.vec3d(*fit_plane(moments, with_tilt))
    for batch in batches:
        shared = [2.0 * np.pi / wavelength, plane, per_replicate]
        per_ray = [batch.pupil, batch.opd, batch.status, batch.phasors]
        launch(sum_phasors, shared, per_ray, len(batch.phasors), device)
    pairs = np.stack([batch.phasors.numpy().sum(axis=0) for batch in batches])
    seconds = dict(ready.seconds)
    seconds["kernel"] = time.perf_counter() - start
    return moments_in_metres(moments, pupil), pairs @ [1.0, 1.0j], int(moments[:, 11].sum()), seconds


def _trace_replicate(ready, pupil, axes, look, seed_array, count, device) -> SimpleNamespace:
    """Launch, trace and sum one replicate; its wavefront stays on the device."""
    position = wp.empty(count, dtype=wp.vec3d, device=device)
    direction = wp.empty(count, dtype=wp.vec3d, device=device)
    coordinates = wp.empty(count, dtype=wp.vec2d, device=device)
    geometry = [wp.vec3d(*pupil.center), wp.vec3d(*axes[0]), wp.vec3d(*axes[1]), wp.vec3d(*look), seed_array, count]
    launch(launch_pupil, geometry, [position, direction, coordinates], count, device)
    results = allocate(PUPIL_OUTPUTS, count, device)
    launch(ready.kernel, ready.arguments, [position, direction, *results.values()], count, device)
    group_count = -(-count // GROUP)
    moments = wp.empty((group_count, MOMENT_COUNT), dtype=wp.float64, device=device)
    phasors = wp.empty(group_count, dtype=wp.vec2d, device=device)
    per_ray = [coordinates, *(results[n] for n in ("opd", "step_error", "evaluation_count", "status")), moments]
    launch(sum_moments, [count], per_ray, len(moments), device)
    return SimpleNamespace(
        pupil=coordinates, opd=results["opd"], status=results["status"], moments=moments, phasors=phasors
    )
