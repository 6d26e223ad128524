"""Collimated rays along z, traced by tables of what each column of the grid gathers; the others as ever."""

import time
from dataclasses import replace

import numpy as np

from ..medium import IndexField
from ..rays import RayBundle
from .collimated import find_columns
from .engines import engine_of
from .launch import in_chunks
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
    ready = engine_of(plan.backend, plan.device).prepare_columns(field, columns, plan, outputs)
    rows = columns.inside
    if rows.all():
        arrays, seconds = in_chunks(ready, (rays.position,), outputs)
        return arrays, {**seconds, "prepare": prepared}
    arrays, seconds = in_chunks(ready, (rays.position[rows],), outputs)
    others, more = run(field, RayBundle(rays.position[~rows], rays.direction[~rows]), rest, until, wavelength, outputs)
    merged = {}
    for name, array in arrays.items():
        merged[name] = np.empty((rays.ray_count, *array.shape[1:]), dtype=array.dtype)
        merged[name][rows], merged[name][~rows] = array, others[name]
    seconds["prepare"] = prepared
    return merged, {name: seconds.get(name, 0.0) + more.get(name, 0.0) for name in {**seconds, **more}}
