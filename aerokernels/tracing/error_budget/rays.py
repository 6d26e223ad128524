"""Choose the rays of a bundle that an error budget traces again: evenly spread ones, and those that may be worst.

A few rays in a thousand may pass a feature about one cell wide and have the greatest error; an evenly spread subset
misses them. Rays are therefore compared by the sharpness of the samples along their straight lines,

    roughness = sum over places on the line, and over the axes, of |d4 m| (cubic) or |d2 m| (other interpolants)

where d2 and d4 are the second and fourth difference of the samples about the node nearest to the place. To lowest order
this is the error of the field's coarser versions there. On a mesh the second difference is that of mesh_sharpness.py.

A ray in a thousand may also have the greatest error of the steps, as those near a focus: they need few long steps. The
trace has estimated this error of every ray, so the rays with the greatest estimates belong to the subset.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from ...medium import IndexField
from ...medium.grid import UniformGrid
from ...rays import RayBundle
from ..lines import box_span
from .mesh_sharpness import raster_of

# Rays that a budget traces, and how many of them are the rays in the sharpest air.
SUBSET = 192
SHARPEST = 64
# Rays with the greatest step errors by the trace's own estimate, which a budget traces beside the others.
LEAST_ACCURATE = 32
# Rays that are compared, and places along each.
COMPARED = 4096
PLACES = 192
# Weights of the differences; the other interpolants are piecewise linear, or locally so at extremes.
DIFFERENCES = {"cubic": (1.0, -4.0, 6.0, -4.0, 1.0)}
OTHER_DIFFERENCES = (1.0, -2.0, 1.0)


def subset(field: IndexField, rays: RayBundle, good: np.ndarray, step_error: np.ndarray | None = None) -> np.ndarray:
    """Return the rows of up to SUBSET + LEAST_ACCURATE of the rays that arrived.

    Args:
        field: The refractive index.
        rays: The bundle.
        good: Which rays arrived, shape (ray_count,).
        step_error: The trace's own estimate of the error of each ray's steps [m], shape (ray_count,), if it was kept.
    """
    arrived = np.flatnonzero(good)
    rows = _evenly(arrived, SUBSET)
    if len(arrived) <= SUBSET:
        return rows
    compared = _evenly(arrived, COMPARED)
    some = rays.rows(compared)
    strength = roughness(field, some.position, some.direction)
    sharpest = compared[np.argsort(strength, kind="stable")[-SHARPEST:]]
    rows = np.union1d(_evenly(arrived, SUBSET - SHARPEST), sharpest)
    if step_error is not None:
        estimate = np.nan_to_num(np.asarray(step_error)[arrived])
        rows = np.union1d(rows, arrived[np.argpartition(estimate, -LEAST_ACCURATE)[-LEAST_ACCURATE:]])
    return rows


def _evenly(rows: np.ndarray, count: int) -> np.ndarray:
    """Return up to `count` of some rows, evenly spread."""
    if len(rows) <= count:
        return rows
    return rows[np.linspace(0, len(rows) - 1, count).round().astype(int)]


def roughness(field: IndexField, position: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Roughness of a field's samples along straight lines, by the formula of the module, shape (n,)."""
    span = box_span(field, position, direction)
    meets = span.meets & (span.leave < 1e30)  # a planar field has no end in x
    enter, leave = np.where(meets, span.enter, 0.0), np.where(meets, span.leave, 0.0)
    length = leave - enter
    samples = field.samples
    differences: Callable[[np.ndarray], np.ndarray]
    if isinstance(samples, UniformGrid):
        differences = partial(_differences, samples)
    else:
        differences = field.derive("raster of sharpness", partial(raster_of, samples)).at
    found = np.zeros(len(position))
    for share in (np.arange(PLACES) + 0.5) / PLACES:  # one place at a time, so that arrays stay small
        local = field.local_coordinates(position + (enter + share * length)[:, None] * direction)
        found += differences(local)
    return found * length


def _differences(grid: UniformGrid, local: np.ndarray) -> np.ndarray:
    """Return the sum over the axes of the differences of samples about the nodes nearest to places (n, d), (n,)."""
    weights = DIFFERENCES.get(grid.interpolation, OTHER_DIFFERENCES)
    half = len(weights) // 2
    node = np.rint((local - grid.origin) / grid.spacing).astype(np.int64)
    node = np.clip(node, 0, np.array(grid.shape) - 1)
    found = np.zeros(len(local))
    for axis, count in enumerate(grid.shape):
        if count <= 2 * half:
            continue
        here = list(node.T)
        middle = np.minimum(here[axis], count - 1 - half)
        if not (axis == 0 and grid.even_first_axis):
            middle = np.maximum(middle, half)
        change = np.zeros(len(local))
        for offset, weight in enumerate(weights, -half):
            here[axis] = np.abs(middle + offset)  # the mirror image across an axis
            change += weight * grid.samples[tuple(here)].astype(np.float64)
        found += np.abs(change)
    return found
