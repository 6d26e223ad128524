"""Collimated rays along z, looked up in projection tables; all other rays are traced as usual."""

from dataclasses import replace

import numpy as np

from ..medium import IndexField
from ..rays import RayBundle
from .collimated import find_projection
from .engines import engine_of
from .launch import in_chunks, starts_of
from .plan import TracePlan


def trace(field: IndexField, rays: RayBundle, plan: TracePlan, until, wavelength: float, outputs: frozenset, run):
    """Trace with the tables: per-ray arrays by name.

    `run` traces the rays that the tables do not cover: (field, rays, plan, until, wavelength, outputs).
    """
    columns = find_projection(field, rays, until)
    rest = replace(plan, method="adaptive", columns=False, sample_count=0)
    if columns is None or not columns.inside.any():
        return run(field, rays, rest, until, wavelength, outputs)
    ready = engine_of(plan.backend, plan.device).prepare_projection(field, columns, plan, outputs)
    rows = columns.inside
    if rows.all():
        return in_chunks(ready, starts_of(rays)[:1], outputs)
    arrays = in_chunks(ready, (rays.position[rows],), outputs)
    others = run(field, rays.rows(~rows), rest, until, wavelength, outputs)
    merged = {}
    for name, array in arrays.items():
        array = np.asarray(array)
        merged[name] = np.empty((rays.ray_count, *array.shape[1:]), dtype=array.dtype)
        merged[name][rows], merged[name][~rows] = np.asarray(array), np.asarray(others[name])
    return merged
