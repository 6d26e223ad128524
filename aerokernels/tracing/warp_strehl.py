"""The million-ray pupil on the device: launch, trace and sums, nothing per ray coming back."""

import functools
import time
from types import SimpleNamespace

import numpy as np
import warp as wp

from . import warp_pupil
from .even import mend_rough
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
from .warp_backend import allocate, launch, launch_trace, prepare
from .warp_pupil import launch_pupil, sum_moments, sum_phasors


@functools.cache
def _load(device: str) -> None:
    wp.load_module(warp_pupil, device=device, block_dim=1 if device == "cpu" else None)


def reduce_pupil(
    field, pupil, look, until, plan, wavelength, per_replicate, replicates, seed, with_tilt, by_radius=False
):
    """Trace a pupil and sum: moments (replicates, MOMENT_COUNT), phasors (replicates,), evaluations, seconds.

    Some replicates at a time are traced. Phasors are summed at once but where the tilt, which all replicates decide,
    is taken out first: what they need then stays on the device.
    """
    ready = prepare(field, plan, until, wavelength, PUPIL_OUTPUTS, look[None])
    device = plan.device
    start = time.perf_counter()
    _load(device)
    ready.seconds["compile"] += time.perf_counter() - start
    start = time.perf_counter()
    seeds = replicate_seeds(seed, replicates)
    order = wp.array(point_order(per_replicate, by_radius), dtype=wp.int32, device=device)
    place = [wp.vec3d(*vector) for vector in (pupil.center, *(pupil.radius * axis for axis in pupil.axes), look)]
    summed = []
    for rows in batches_of(replicates, per_replicate):
        pairs = wp.array(seeds[rows], dtype=wp.uint32, device=device)
        rays = _trace(ready, [*place, pairs, order, per_replicate], (rows.stop - rows.start) * per_replicate, device)
        sums = _Sums(rays, per_replicate, rows.stop - rows.start, wavelength, device)
        sums.add_moments()
        if not with_tilt:
            sums.add_phasors(np.zeros(3))
        if ready.rough is not None and int(ready.rough.numpy()[0]):
            ready.rough.zero_()
            _mend(field, plan, until, wavelength, rays)
            sums.add_moments()
            if not with_tilt:
                sums.add_phasors(np.zeros(3))
        if not with_tilt:
            sums.rays = None
        summed.append(sums)
    moments = np.concatenate([sums.moments() for sums in summed])
    if with_tilt:
        plane = fit_plane(moments, with_tilt)
        for sums in summed:
            sums.add_phasors(plane)
    phasors = np.concatenate([sums.phasors() for sums in summed])
    seconds = dict(ready.seconds)
    seconds["kernel"] = time.perf_counter() - start
    return moments_in_metres(moments, pupil), phasors, int(moments[:, 11].sum()), seconds


def _trace(ready, geometry: list, count: int, device: str) -> SimpleNamespace:
    """Launch and trace some replicates; their wavefronts stay on the device."""
    position = wp.empty(count, dtype=wp.vec3d, device=device)
    direction = wp.empty(count, dtype=wp.vec3d, device=device)
    coordinates = wp.empty(count, dtype=wp.vec2d, device=device)
    launch(launch_pupil, geometry, [position, direction, coordinates], count, device)
    results = allocate(PUPIL_OUTPUTS, count, device)
    launch_trace(ready, position, direction, results, count, device)
    return SimpleNamespace(position=position, direction=direction, pupil=coordinates, results=results)


class _Sums:
    """The sums of some replicates."""

    def __init__(self, rays: SimpleNamespace, per_replicate: int, replicates: int, wavelength: float, device: str):
        self.rays: SimpleNamespace | None = rays
        self.per_replicate, self.device = per_replicate, device
        self.groups = replicates * group_count(per_replicate)
        self.wave_number = 2.0 * np.pi / wavelength
        self._moments = wp.empty((self.groups, MOMENT_COUNT), dtype=wp.float64, device=device)
        self._phasors = wp.empty(self.groups, dtype=wp.vec2d, device=device)

    def add_moments(self) -> None:
        results = self.rays.results
        per_ray = [results[name] for name in ("opd", "step_error", "evaluation_count", "status")]
        arrays = [self.rays.pupil, *per_ray, self._moments]
        launch(sum_moments, [self.per_replicate], arrays, self.groups, self.device)

    def add_phasors(self, plane: np.ndarray) -> None:
        results = self.rays.results
        arrays = [self.rays.pupil, results["opd"], results["status"], self._phasors]
        numbers = [self.wave_number, wp.vec3d(*plane), self.per_replicate]
        launch(sum_phasors, numbers, arrays, self.groups, self.device)

    def moments(self) -> np.ndarray:
        """Moments of the replicates, (n, MOMENT_COUNT)."""
        return join_groups(self._moments.numpy(), self.per_replicate)

    def phasors(self) -> np.ndarray:
        """Phasors of the replicates, (n,)."""
        pairs = self._phasors.numpy() @ [1.0, 1.0j]
        return pairs.reshape(-1, group_count(self.per_replicate)).sum(axis=1)


def _mend(field, plan, until, wavelength: float, rays: SimpleNamespace) -> None:
    """Trace again the rays that even samples do not hold for."""
    names = ("opd", "step_error", "status", "evaluation_count")
    arrays = {name: np.array(rays.results[name].numpy()) for name in names}
    mend_rough(field, rays.position.numpy(), rays.direction.numpy(), plan, until, wavelength, arrays)
    for name, array in arrays.items():
        rays.results[name].assign(array)
