"""The error budget of a trace's optical path difference, by cause.

Causes:

    step            greatest embedded error over the rays that arrived
    interpolation   a third of what leaving out every second node changes along a few rays' straight lines
    resampling      measured when the field was resampled (rms over lines parallel to z)
    precision       rounding: half a unit in the last place of the greatest OPD, times the root of the step count
    sampling        0: a trace is no mean over rays (an estimate over a pupil fills it in)
    total           root sum of squares

A third of the change is what remains if the order is two or more. A cause whose arrays were not asked for in `outputs`
is not known: it is nan, and so is the total.
"""

from dataclasses import replace

import numpy as np

from ..medium import IndexField
from ..medium.grid import UniformGrid
from ..rays import RayBundle

LINE_COUNT = 48
POINT_COUNT = 768


def error_budget(field: IndexField, rays: RayBundle, result) -> dict[str, float]:
    """The budget [m of OPD]."""
    good = result.ok
    step = _greatest(result.step_error, good)
    unit = 2.0**-24 if result.plan.precision == "float32" else 2.0**-53
    step_count = max(_greatest(result.step_count, good), 1.0)
    budget = {
        "step": step,
        "interpolation": interpolation_error(field, rays),
        "resampling": 0.0 if field.resampling is None else field.resampling.opd_rms,
        "precision": unit * _greatest(result.opd, good) * np.sqrt(step_count),
        "sampling": 0.0,
    }
    budget["total"] = float(np.sqrt(sum(v * v for v in budget.values())))
    return {name: float(value) for name, value in budget.items()}


def _greatest(array, good: np.ndarray) -> float:
    """Greatest magnitude over the rays that arrived, nan where the array was not asked for."""
    if array is None:
        return float("nan")
    return float(np.abs(array[good]).max(initial=0.0))


def interpolation_error(field: IndexField, rays: RayBundle) -> float:
    """A third of the rms change of the optical path when every second node is left out [m].

    Zero where the grid has too few nodes. On a field that came from a mesh it is part of the resampling error, and no
    second opinion is taken.
    """
    if not field.is_uniform or field.resampling is not None or min(field.samples.shape) < 9:
        return 0.0
    grid = field.samples
    assert isinstance(grid, UniformGrid)
    every = tuple(slice(None, None, 2) for _ in grid.shape)
    coarse = replace(field, samples=replace(grid, samples=grid.samples[every], spacing=2.0 * grid.spacing))
    rows = np.linspace(0, rays.ray_count - 1, min(LINE_COUNT, rays.ray_count)).astype(int)
    low, high = coarse.box
    start, stop = box_span(low, high, rays.position[rows], rays.direction[rows])
    kept = stop > start
    if not kept.any():
        return 0.0
    start, stop, rows = start[kept], stop[kept], rows[kept]
    fraction = (np.arange(POINT_COUNT) + 0.5) / POINT_COUNT
    along = start[:, None] + (stop - start)[:, None] * fraction
    points = (rays.position[rows, None] + along[..., None] * rays.direction[rows, None]).reshape(-1, 3)
    change = (field.contrast_at(points) - coarse.contrast_at(points)).reshape(len(rows), POINT_COUNT)
    path = change.mean(axis=1) * (stop - start)
    return float(np.sqrt(np.mean(path**2))) / 3.0


def box_span(low, high, position, direction) -> tuple[np.ndarray, np.ndarray]:
    """Where straight rays enter and leave a box (entry at least 0) [m]; entry >= exit means a miss."""
    with np.errstate(divide="ignore", invalid="ignore"):
        near, far = (low - position) / direction, (high - position) / direction
    parallel = direction == 0.0
    outside = parallel & ((position < low) | (position > high))
    near = np.where(parallel, -np.inf, near)
    far = np.where(parallel, np.inf, far)
    enter = np.maximum(np.minimum(near, far).max(axis=1), 0.0)
    leave = np.maximum(near, far).min(axis=1)
    return enter, np.where(outside.any(axis=1), -np.inf, leave)
