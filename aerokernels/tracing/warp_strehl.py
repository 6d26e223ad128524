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
    seeds = replicate_seeds(seed, replicates)
    axes = [pupil.radius * axis for axis in pupil.axes]
    moments = np.zeros((replicates, MOMENT_COUNT))
    phasor = np.zeros(replicates, dtype=np.complex128)
    kept = []
    for replicate in range(replicates):
        batch = _trace_replicate(ready, pupil, axes, look, seeds[replicate], per_replicate, device)
        kept.append(batch)
        moments[replicate] = join_groups(batch.moments.numpy())
    evaluations = int(moments[:, 11].sum())
    plane = wp.vec3d(*fit_plane(moments, with_tilt))
    for replicate, batch in enumerate(kept):
        out = wp.empty(len(batch.moments), dtype=wp.vec2d, device=device)
        shared = [2.0 * np.pi / wavelength, plane, per_replicate]
        launch(sum_phasors, shared, [batch.pupil, batch.opd, batch.status, out], len(out), device)
        pair = out.numpy().sum(axis=0)
        phasor[replicate] = complex(pair[0], pair[1])
    seconds = dict(ready.seconds)
    seconds["kernel"] = time.perf_counter() - start
    return moments_in_metres(moments, pupil), phasor, evaluations, seconds


def _trace_replicate(ready, pupil, axes, look, seeds, count, device) -> SimpleNamespace:
    """Launch, trace and sum one replicate; its wavefront stays on the device."""
    position = wp.empty(count, dtype=wp.vec3d, device=device)
    direction = wp.empty(count, dtype=wp.vec3d, device=device)
    coordinates = wp.empty(count, dtype=wp.vec2d, device=device)
    seed_array = wp.array(seeds[None], dtype=wp.uint32, device=device)
    geometry = [wp.vec3d(*pupil.center), wp.vec3d(*axes[0]), wp.vec3d(*axes[1]), wp.vec3d(*look), seed_array, count]
    launch(launch_pupil, geometry, [position, direction, coordinates], count, device)
    results = allocate(PUPIL_OUTPUTS, count, device)
    launch(ready.kernel, ready.arguments, [position, direction, *results.values()], count, device)
    moments = wp.empty((-(-count // GROUP), MOMENT_COUNT), dtype=wp.float64, device=device)
    per_ray = [coordinates, *(results[n] for n in ("opd", "step_error", "evaluation_count", "status")), moments]
    launch(sum_moments, [count], per_ray, len(moments), device)
    return SimpleNamespace(pupil=coordinates, opd=results["opd"], status=results["status"], moments=moments)
