"""Choose the rays of a bundle that an error budget traces again: some evenly spread, and those in the sharpest air.

A few rays in a thousand may pass a feature about one cell wide and have the greatest error; an evenly spread subset
misses them. Rays are therefore compared by the sharpness of the samples along their straight lines,

    roughness = sum over places on the line, and over the axes, of |d4 m| (cubic) or |d2 m| (other interpolants)

where d2 and d4 are the second and fourth difference of the samples about the node nearest to the place. To lowest order
this is the error of the field's coarser versions there. For a field on a mesh the subset is evenly spread.
"""

import numpy as np

from ...medium import IndexField
from ...medium.grid import UniformGrid
from ...rays import RayBundle
from ..lines import box_span

# Rays that a budget traces, and how many of them are the rays in the sharpest air.
SUBSET = 192
SHARPEST = 64
# Rays that are compared, and places along each.
COMPARED = 4096
PLACES = 192
# Weights of the differences; the other interpolants are piecewise linear, or locally so at extremes.
DIFFERENCES = {"cubic": (1.0, -4.0, 6.0, -4.0, 1.0)}
OTHER_DIFFERENCES = (1.0, -2.0, 1.0)


def subset(field: IndexField, rays: RayBundle, good: np.ndarray) -> np.ndarray:
    """Return the rows of up to SUBSET of the rays that arrived; `good` says which did, shape (ray_count,)."""
    arrived = np.flatnonzero(good)
    rows = _evenly(arrived, SUBSET)
    if len(arrived) > SUBSET and field.is_uniform:
        compared = _evenly(arrived, COMPARED)
        some = rays.rows(compared)
        strength = roughness(field, some.position, some.direction)
        sharpest = compared[np.argsort(strength, kind="stable")[-SHARPEST:]]
        rows = np.union1d(_evenly(arrived, SUBSET - SHARPEST), sharpest)
    return rows


def _evenly(rows: np.ndarray, count: int) -> np.ndarray:
    """Return up to `count` of some rows, evenly spread."""
    if len(rows) <= count:
        return rows
    return rows[np.linspace(0, len(rows) - 1, count).round().astype(int)]


def roughness(field: IndexField, position: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Roughness of a uniform grid's samples along straight lines, by the formula of the module, shape (n,)."""
    grid = field.samples
    assert isinstance(grid, UniformGrid)
    span = box_span(field, position, direction)
    meets = span.meets & (span.leave < 1e30)  # a planar field has no end in x
    enter, leave = np.where(meets, span.enter, 0.0), np.where(meets, span.leave, 0.0)
    length = leave - enter
    weights = DIFFERENCES.get(field.interpolation, OTHER_DIFFERENCES)
    half = len(weights) // 2
    found = np.zeros(len(position))
    for share in (np.arange(PLACES) + 0.5) / PLACES:  # one place at a time, so that arrays stay small
        local = field.local_coordinates(position + (enter + share * length)[:, None] * direction)
        node = np.rint((local - grid.origin) / grid.spacing).astype(np.int64)
        node = np.clip(node, 0, np.array(grid.shape) - 1)
        for axis, count in enumerate(grid.shape):
            if count <= 2 * half:
                continue
            here = list(node.T)
            middle = np.minimum(here[axis], count - 1 - half)
            if not (axis == 0 and grid.even_first_axis):
                middle = np.maximum(middle, half)
            change = np.zeros(len(position))
            for offset, weight in enumerate(weights, -half):
                here[axis] = np.abs(middle + offset)  # the mirror image across an axis
                change += weight * grid.samples[tuple(here)]
            found += np.abs(change)
    return found * length
