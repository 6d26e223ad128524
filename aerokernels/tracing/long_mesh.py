"""Warn of many rays through a mesh before they are traced: a resampled field takes a small part of the time.

Error control ends steps at the edges between the cells of a mesh where the gradient jumps too much for the tolerance,
so that a ray needs up to a few evaluations for each cell that it crosses. How many is not predicted but seen: a few of
the rays are traced.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from aerokernels.inputs.checks import warn_caller

from ..medium import IndexField
from ..rays import RayBundle
from .engines import engine_of
from .launch import launch
from .plan import TracePlan

# Rays that are traced to see how many evaluations they need, and the number of rays from which they are.
SOME, MANY = 32, 2000
# Evaluations of all rays that take two cores some ten seconds at most, and how many times as many an H100 makes.
LONG, ON_GPU = 2e7, 500.0


def seen_in_mesh(
    field: IndexField, pilot: Callable[[], RayBundle], ray_count: int, until, wavelength: float, plan: TracePlan
) -> TracePlan:
    """Return the plan of so many rays with the evaluations that some of them need in a mesh; warn if they take long.

    The plan for any other field, for few rays, or without error control is returned as it is.
    """
    if field.is_uniform or ray_count < MANY or plan.method != "adaptive" or plan.backend == "reference":
        return plan
    rays = pilot()
    some = rays.rows(np.linspace(0, rays.ray_count - 1, min(SOME, rays.ray_count)).round().astype(int))
    found = launch(field, some, plan, until, wavelength, frozenset(["evaluation_count"]))
    each = float(np.mean(np.asarray(found["evaluation_count"])))
    limit = LONG * (ON_GPU if engine_of(plan.backend, plan.device).is_gpu else 1.0)
    if each * ray_count < limit:
        return replace(plan, predicted_evaluations=each)
    needed = f"about {float(f'{each:.2g}'):,.0f} evaluations for each of {ray_count:,} rays"
    warn_caller(
        f"through this mesh error control needs {needed}, which takes long: "
        f"field.resample(tolerance={plan.tolerance:g}) makes a uniform grid of it, through which a ray takes a few "
        "microseconds, and measures the error that this adds"
    )
    return replace(
        plan,
        predicted_evaluations=each,
        reasons=(*plan.reasons, f"a mesh, not resampled: {needed}, seen in {SOME} rays"),
    )
