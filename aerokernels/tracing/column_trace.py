"""Collimated rays along z, traced by tables of what each column of the grid gathers; the others as ever."""

import time
from dataclasses import replace

import numpy as np

from ..medium import IndexField
from ..rays import RayBundle
from .collimated import find_columns
from .plan import TracePlan


def trace(field: IndexField, rays: RayBundle, plan: TracePlan, until, wavelength: float, outputs: frozenset, run):
    """Trace with the tables: per-ray arrays by name, and seconds.

    `run` traces the rays that they do not hold for: (field, rays, plan, until, wavelength, outputs).
    """
    start = time.perf_counter()
    columns = find_columns(field, rays, until)
    prepared = time.perf_counter() - start
    rest = replace(plan, method="adaptive", columns=False, sample_count=0)
    if columns is None or not columns.inside.any():
        return run(field, rays, rest, until, wavelength, outputs)
    if plan.backend == "opencl":
        from .opencl_columns import trace_columns
    else:
        from .warp_column_backend import trace_columns
    rows = columns.inside
    if rows.all():
        arrays, seconds = trace_columns(field, rays.position, columns, plan, outputs)
        return arrays, {**seconds, "prepare": prepared}
    arrays, seconds = trace_columns(field, rays.position[rows], columns, plan, outputs)
    others, more = run(field, RayBundle(rays.position[~rows], rays.direction[~rows]), rest, until, wavelength, outputs)
    merged = {}
    for name, array in arrays.items():
        merged[name] = np.empty((rays.ray_count, *array.shape[1:]), dtype=array.dtype)
        merged[name][rows], merged[name][~rows] = array, others[name]
    seconds["prepare"] = prepared
    return merged, {name: seconds.get(name, 0.0) + more.get(name, 0.0) for name in {**seconds, **more}}
