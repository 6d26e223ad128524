"""Bound, block by block, the structure of a field between leapfrog samples, so that no ray misses it unnoticed.

The midpoint rule with samples H apart misses frequencies of 1 / H and above, at most 2 int |R| dt of the high-passed
part R (high_pass.py), or the rule's own H^4 / 720 int |f''''| dt if that is less. Where a ray ends in disturbed air a
component a cos(2 pi phi t) costs a H / 2 and, with x = phi H small, 9.5 a H x^3. An error of the slope, at most
MISSED_SLOPE for each cell, counts in the second order of the contrast or by the lever arm to the stop. See
docs/theory/leapfrog.md.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce

import numpy as np

from aerokernels.derived import cached_on
from aerokernels.medium import IndexField
from aerokernels.medium.grid import UniformGrid
from aerokernels.tracing.blocks import block_maxima, block_means, by_slabs, greatest_around
from aerokernels.tracing.scheme import MISSED_SLOPE
from aerokernels.tracing.step_bound import block_size, potential_at_nodes, roughness_of_blocks
from aerokernels.tracing.tasks.high_pass import high_pass

# Frequencies along a ray, times H, from which on components are passed: along the ray, and at its ends, where half of
# the share that is passed (high_pass.py) is then 9.9 x^3 for small x.
EDGE, EDGE_AT_ENDS = 0.92, 0.37
# The error at an end over H |R| there, and over H times the rule's own bound elsewhere, which is for a metre of path.
END, RULE_AT_END = 0.5, 3.0 * (8.0 - 1.0)
# The error over int |R| dt: one for the sum, and one for the integral.
BOTH = 2.0
# Components of a direction below which no neighbouring block is met within half a stride.
LEAST_OBLIQUITY = 0.05
# Least component along an axis that all rays run along; greatest components along the other axes for which rays move by
# less than a cell in a block.
LEAST_MAIN, LEVEL = 0.7, 0.25
# Blocks along that axis over which a lookup averages; strides are shorter where a ray ends and find fewer of them.
LOOKED_OVER, LOOKED_SHORT = 3, 1.1
# In place of the blocks in which rays end: all of them.
EVERYWHERE = b"everywhere"


@dataclass(frozen=True)
class Sampling:
    """How a bundle is sampled."""

    spacing: float  # greatest distance of a ray's samples [m]
    steepness: tuple[float, float, float]  # greatest absolute components of the rays' unit vectors
    lever_arm: float  # change of the path by an error of direction where the stop is met at a right angle [m/rad]
    is_fine: bool = True  # whether rounding to single precision would be visible in the bound
    ends: bytes = b""  # blocks in which rays end in disturbed air (`disturbed_ends`), or EVERYWHERE


def with_neighbors(values: np.ndarray) -> np.ndarray:
    """For each block the greatest value of it and of all adjacent blocks."""
    return greatest_around(values, [-1] * values.ndim, [1] * values.ndim)


@cached_on("grid")
def potential_by_blocks(grid: UniformGrid) -> np.ndarray:
    """Greatest absolute potential over the ambient index in each block."""
    block = block_size(grid)

    def greatest(rows: slice) -> np.ndarray:
        return block_maxima(np.abs(potential_at_nodes(grid, rows)), block)

    return by_slabs(greatest, grid.shape, block, 0)


def lookup_table(field: IndexField, sampling: Sampling) -> tuple[int, np.ndarray]:
    """Cells in a block, and the table in which kernels look up the error once within a stride of a ray."""
    from scipy.ndimage import uniform_filter1d

    block, missed = missed_in_blocks(field, sampling, False)
    obliquities, main = along_axes(sampling.steepness, field.geometry), _main_axis(sampling.steepness, field.geometry)
    for axis, obliquity in enumerate(obliquities):
        if axis == main:
            missed = LOOKED_SHORT * uniform_filter1d(missed, LOOKED_OVER, axis=axis, mode="nearest")
        elif obliquity > LEAST_OBLIQUITY:
            # Blocks that are found a block and a half away along the main axis are beside the ray by that slope.
            wide = 3 if main is None or obliquity < 0.5 * obliquities[main] else 5
            beside = wide // 2 * np.eye(missed.ndim, dtype=int)[axis]
            missed = greatest_around(missed, -beside, beside)
    return block, missed


@cached_on("field", 32)
def missed_in_blocks(field: IndexField, sampling: Sampling, by_rule: bool) -> tuple[int, np.ndarray]:
    """Cells in a block, and for each the greatest error of a ray's path per metre in it, without that at ends.

    With `by_rule` it is the rule's own bound, which is faster to compute and never less.
    """
    grid = grid_of(field)
    block, geometry, factor = block_size(grid), field.geometry, turned(grid, sampling.lever_arm)
    missed = _by_rule(grid, geometry, sampling)
    if by_rule:
        return block, factor * missed
    part, _, share = _not_resolved(grid, geometry, sampling, EDGE)
    rest = _by_blocks(grid, geometry, sampling, lambda nodes: np.abs(part[nodes]))
    main = _main_axis(sampling.steepness, geometry)
    return block, factor * np.minimum(missed, BOTH * share * _with_lobes(rest, main))


def grid_of(field: IndexField) -> UniformGrid:
    """The samples of a field on a uniform grid."""
    assert isinstance(field.samples, UniformGrid)
    return field.samples


def turned(grid: UniformGrid, lever_arm: float) -> float:
    """The factor by which an error grows with its error of direction, by the lever arm of a Sampling [m/rad]."""
    return 1.0 + MISSED_SLOPE * lever_arm / float(grid.spacing.min())


@cached_on("field", 32)
def missed_at_ends(field: IndexField, sampling: Sampling, by_rule: bool) -> np.ndarray | None:
    """For each block the greatest error of a ray's path by beginning or ending in it [m]; None for rays that do not."""
    if not sampling.ends:
        return None
    grid, geometry = grid_of(field), field.geometry
    found = RULE_AT_END * sampling.spacing * _by_rule(grid, geometry, sampling)
    if not by_rule:
        part, spacing, share = _not_resolved(grid, geometry, sampling, EDGE_AT_ENDS)
        block = block_size(grid)
        size = by_slabs(lambda rows: block_maxima(np.abs(part[rows]), block), grid.shape, block, 0)
        if sampling.ends != EVERYWHERE:  # elsewhere the part is not known, but no greater than twice the whole
            count = int(np.prod(size.shape))
            ends = np.unpackbits(np.frombuffer(sampling.ends, np.uint8), count=count).reshape(size.shape)
            size = np.where(ends, size, 2.0 * potential_by_blocks(grid))
        found = np.minimum(found, END * share * spacing * size)
    return turned(grid, sampling.lever_arm) * with_neighbors(found)


@cached_on("grid", 2)
def _by_rule(grid: UniformGrid, geometry: str, sampling: Sampling) -> np.ndarray:
    """The rule's own bound in each block, per metre of path [1]."""
    _, fourth, _ = roughness_of_blocks(grid)
    # Greatest value of the end-corrected midpoint rule's Peano kernel, the Bernoulli polynomial of degree 4 over 4!.
    scales = [(1.0 / 720.0) * float(u * sampling.spacing) ** 4 for u in along_axes(sampling.steepness, geometry)]
    return _joined([scale * change for scale, change in zip(scales, fourth, strict=True)])


@cached_on("field", 32)
def changes_missed(field: IndexField, sampling: Sampling) -> np.ndarray:
    """Greatest change of the missed potential across the rays in each block, per metre of path [1/m]."""
    grid, geometry = grid_of(field), field.geometry
    part, _, share = _not_resolved(grid, geometry, sampling, EDGE)
    main = _main_axis(sampling.steepness, geometry)
    obliquity = along_axes(sampling.steepness, geometry)

    def size(nodes: tuple[slice, ...]) -> np.ndarray:
        square = np.zeros_like(part[nodes])
        for axis in range(square.ndim):
            # Along the axis that all rays run along, only the component across the rays counts.
            across = 1.0 if axis != main else min(1.0, float(np.linalg.norm(np.delete(obliquity, axis))))
            square += np.square(_slopes(part, axis, nodes) * square.dtype.type(across / grid.spacing[axis]))
        return np.sqrt(square)

    rest = _by_blocks(grid, geometry, sampling, size)
    return BOTH * share * _with_lobes(rest, main)


def _slopes(values: np.ndarray, axis: int, nodes: tuple[slice, ...]) -> np.ndarray:
    """The greatest slope along an axis of a spline through values, per cell, in both cells beside some nodes."""
    first, last, _ = nodes[axis].indices(values.shape[axis])
    begin = max(first - 2, 0)  # bends about the next nodes count
    rows = np.moveaxis(values[(*nodes[:axis], slice(begin, last + 2), *nodes[axis + 1 :])], axis, 0)
    steps = np.diff(rows, axis=0)
    bends = np.diff(steps, axis=0)
    np.abs(steps, out=steps)
    np.abs(bends, out=bends)
    # The slope of a spline in a cell is at most the difference of its nodes and this share of the second differences at
    # both: through one outstanding node it is sqrt(3) times the difference.
    bends *= values.dtype.type(0.25)
    steps[1:] += bends
    steps[:-1] += bends
    found = np.empty_like(rows)
    found[0], found[-1] = steps[0], steps[-1]
    np.maximum(steps[1:], steps[:-1], out=found[1:-1])
    return np.moveaxis(found[first - begin : last - begin], 0, axis)


def _not_resolved(grid: UniformGrid, geometry: str, sampling: Sampling, edge: float) -> tuple[np.ndarray, float, float]:
    """The part of the potential at nodes that samples some distance apart do not resolve: along rays, or at ends."""
    obliquity = along_axes(sampling.steepness, geometry)
    # At higher frequencies a spline's images fall off as the fourth power of the frequency.
    # With fewer cells than this between samples, R is computed for this many and scaled: a spline's images have no end.
    finest = 0.8 / max(float((obliquity / grid.spacing).max()), 1.0 / float((grid.high - grid.low).max()))
    spacing, share = max(sampling.spacing, finest), min(sampling.spacing / finest, 1.0) ** 4
    return high_pass(grid, obliquity, spacing, edge, sampling.is_fine), spacing, share


def _by_blocks(
    grid: UniformGrid, geometry: str, sampling: Sampling, size_at: Callable[[tuple[slice, ...]], np.ndarray]
) -> np.ndarray:
    """Greatest mean that a ray meets on its path through each block, of sizes at nodes, along the rays' main axis."""
    block = block_size(grid)
    obliquity, main = along_axes(sampling.steepness, geometry), _main_axis(sampling.steepness, geometry)
    across = [axis for axis in range(len(obliquity)) if axis != main]

    def of_slab(nodes: slice) -> np.ndarray:
        size = size_at(tuple(nodes if axis == across[0] else slice(None) for axis in range(len(grid.shape))))
        if main is None:
            return block_maxima(size, block)
        if obliquity[across].max(initial=0.0) > LEVEL:
            return block_means(block_maxima(size, block, across), block, main)
        return block_maxima(block_means(size, block, main), block, across)

    return by_slabs(of_slab, grid.shape, block, across[0])


def _with_lobes(rest: np.ndarray, main: int | None) -> np.ndarray:
    """Values of blocks, raised to the overshoot of their neighbours' splines into them."""
    for axis in range(rest.ndim):
        if axis != main:
            # Overshoot of a spline through one outstanding node between the next two nodes, at most, over the node's
            # value.
            beside = np.eye(rest.ndim, dtype=int)[axis]
            rest = np.maximum(rest, 0.15 * greatest_around(rest, -beside, beside))
    return rest.astype(np.float64)


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    """Combine the axes' fourth derivatives to that of a structure with one normal: see step_bound.py."""
    some = [part for part in parts if part.any()] or parts[:1]  # powers of zeros are slow too
    root = reduce(np.add, [np.sqrt(np.sqrt(part)) for part in some])  # a tenth of the time of powers
    return np.square(np.square(root))


def _main_axis(steepness, geometry: str) -> int | None:
    """The grid's axis that all rays of that steepness run along, None where there is none."""
    least = np.sqrt(np.maximum(1.0 - (np.sum(np.square(steepness)) - np.square(steepness)), 0.0))
    first = {"volume": 0, "planar": 1, "axisymmetric": 2}[geometry]
    axis = first + int(np.argmax(least[first:]))
    shift = 1 if geometry != "volume" else 0
    return axis - shift if least[axis] > LEAST_MAIN else None


def along_axes(steepness, geometry: str) -> np.ndarray:
    """Greatest absolute components along the grid's own axes, which are r and z for an axisymmetric grid."""
    x, y, z = steepness
    return np.array({"volume": (x, y, z), "planar": (y, z), "axisymmetric": (min(np.hypot(x, y), 1.0), z)}[geometry])
