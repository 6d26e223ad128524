"""Trace a pupil on the reference backend and form the sums of the other backends' kernels in NumPy."""

import numpy as np

from aerokernels.tracing.tasks.quadrature import lattice_points, smoothed_axes
from aerokernels.tracing.tasks.sums import (
    MOMENT_COUNT,
    PUPIL_OUTPUTS,
    PupilSums,
    PupilTask,
    fit_surface,
    moments_in_metres,
    radial_rays,
)

from ....pupils import across_look
from ....rays import RayBundle
from ...absorption import absorbs, amplitudes
from ...launch import run_plan
from ...stop import reached


class PupilRun:
    """A pupil that can be traced repeatedly; its points are those of `RayBundle.collimated`, one seed per replicate."""

    def __init__(self, task: PupilTask):
        """Take the task; nothing needs preparation."""
        self.task = task

    def __call__(self, seed: int) -> PupilSums:
        """Trace the rays of every replicate, and return their sums."""
        task = self.task
        moments = np.zeros((task.replicates, MOMENT_COUNT))
        kept = []
        for replicate in range(task.replicates):
            position, direction, place, weight = self._rays(replicate, seed)
            if absorbs(task.field):
                rays = RayBundle(position, direction)
                weight = weight * amplitudes(task.field, rays, task.plan, task.until, task.wavelength)
            place = place @ across_look(task.pupil, task.look).T
            arrays = run_plan(
                task.field, RayBundle(position, direction), task.plan, task.until, task.wavelength, PUPIL_OUTPUTS
            )
            good = reached(arrays["status"])
            (x, y), share, opd = place[good].T, weight[good], arrays["opd"][good]
            terms = (np.ones_like(x), x, y, opd, x * x, x * y, y * y, x * opd, y * opd, opd * opd)
            worst = arrays["step_error"][good].max(initial=0.0)
            q = x * x + y * y
            of_square = (share @ term for term in (x * q, y * q, q * q, q * opd))
            evaluations = arrays["evaluation_count"].sum()
            moments[replicate] = [*(share @ term for term in terms), worst, evaluations, *of_square]
            kept.append((x, y, share, opd))
        # Phases are relative to the fitted surface: they are small, and so is their rounding.
        height, right, up, focus = fit_surface(moments, task.terms)
        wave = 2j * np.pi / task.wavelength
        phasors = [
            share @ np.exp(wave * (w - height - right * x - up * y - focus * (x * x + y * y)))
            for x, y, share, w in kept
        ]
        ray_count = task.replicates * task.per_replicate
        return PupilSums(moments_in_metres(moments, task), np.array(phasors), ray_count)

    def _rays(self, replicate: int, seed: int) -> tuple[np.ndarray, ...]:
        task = self.task
        if task.is_radial:
            position, place, weight = radial_rays(task.pupil, task.points(seed), slice(replicate, replicate + 1))
            return position, np.repeat(task.look[None], len(position), axis=0), place, weight
        if task.generator:
            square, weight = lattice_points(
                task.per_replicate, smoothed_axes(task.pupil.square_map), task.points(seed)[replicate]
            )
            place = task.pupil.square_map.points(square)
            position = task.pupil.center + task.pupil.reach * place @ np.stack(task.pupil.axes)
            return position, np.repeat(task.look[None], len(place), axis=0), place, weight
        seed = seed * task.replicates + replicate
        rays = RayBundle.collimated(task.pupil, task.per_replicate, direction=task.look, seed=seed)
        place = (rays.position - task.pupil.center) @ np.stack(task.pupil.axes, axis=1) / task.pupil.reach
        return rays.position, rays.direction, place, np.ones(task.per_replicate)
