r"""The reference engine: traces whole bundles in float64 NumPy, for readability and without formulas of the kernels.

"adaptive" and "straight" integrate with steps.py: DOP853 within one smooth piece of the field after another, to the
requested tolerance, at most LAXEST. "fixed" and "paper" take the steps of their rule with rule.py. `step_error` is
the sum over the steps of the errors by the embedded formulas, multiplied by their lever arms to the stop, and of
rounding; of "straight" it is at least the difference from the bent ray.
"""

from dataclasses import replace

import numpy as np

from ....medium import IndexField
from ....pupils import across_look
from ....rays import RayBundle
from ...plan import TracePlan
from ...pupil.quadrature import lattice_points, smoothed_axes
from ...pupil.sums import MOMENT_COUNT, PUPIL_OUTPUTS, PupilSums, PupilTask, fit_surface, moments_in_metres, radial_rays
from ...result import RAY_OUTPUTS
from ...status import RayStatus, reached
from ...trace import run_plan
from .ends import Ends
from .medium import GridAir
from .mesh import MeshAir
from .rule import march
from .steps import Integrator

# The greatest tolerance with which it integrates [waves], and the share of the tolerance that the steps may use.
LAXEST = 1e-9
SHARE = 0.1


def trace(field: IndexField, rays: RayBundle, plan: TracePlan, until, wavelength: float, outputs: frozenset):
    """Trace a bundle and return per-ray arrays by name."""
    start, heading = np.array(rays.position), np.array(rays.direction)
    ends = Ends(field, until)
    interval = ends.interval(start, heading)
    rows = np.flatnonzero(interval.meets & (interval.status == RayStatus.OK))
    flight, turn = None, np.zeros((0, 3))
    if len(rows):
        air = GridAir(field) if field.is_uniform else MeshAir(field)
        some = type(interval)(*(getattr(interval, name)[rows] for name in interval.__dataclass_fields__))
        entry = start[rows] + some.t_enter[:, None] * heading[rows]
        flight = ends.flight(start[rows], heading[rows], some, air.cell_at(entry, heading[rows]))
        integrator = Integrator(
            air,
            field.ambient_index,
            ends,
            SHARE * min(plan.tolerance, LAXEST) * wavelength,
            plan.max_steps,
            plan.method == "straight" and not air.jumps,
        )
        if plan.method in ("fixed", "paper"):
            turn = march(field, ends, flight, plan)
        else:
            inside = np.flatnonzero(~air.in_gap(flight.cell))
            integrator.begin(flight, inside)
            integrator.run(flight)
            turn = integrator.turn(flight.direction, flight.momentum)
    found = ends.finish(interval, rows, flight, turn, start, heading, plan.method == "straight")
    if plan.method == "straight":
        bent = trace(field, rays, replace(plan, method="adaptive"), until, wavelength, frozenset({"opd"}))
        error = np.where(reached(bent["status"]), np.abs(found["opd"] - bent["opd"]), np.inf)
        fine = reached(found["status"])
        found["step_error"][fine] = np.maximum(found["step_error"], error)[fine]
        found["status"][fine & ~(found["step_error"] <= plan.tolerance * wavelength)] = RayStatus.TOLERANCE_NOT_MET
    return {name: found[name] for name in [*RAY_OUTPUTS, "status"] if name in outputs | {"status"}}


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
