r"""Bound, block by block, the structure of a field between leapfrog samples, so that no ray misses it unnoticed.

The error of the midpoint rule with samples H apart, on a line along which the potential is f, is

    E = sum over k != 0 of (-1)^k F(k / H)

with F the Fourier transform of f: it comes from the components of f with frequencies of 1 / H and above. No estimate
from the samples can see them, nor can other rays (a pilot) that pass elsewhere: the bound comes from the field.

It is split into a part of low frequencies along the rays, on which the rule converges faster than any power of H, and
a high-passed part R (high_pass.py) of the components from about 0.9 / H on. The error of the rule on R is at most
2 int |R| dt along the ray.

Where all rays run along one axis, within some 45 degrees, |R| is averaged along it over each block of cells: the sum
over blocks is the integral. Across the rays the greatest value counts.

Where a ray begins or ends in disturbed air, the convergence on whole lines does not apply: for a component
a cos(2 pi phi t) the end corrections of the rule have an error of a H / 2 and, with x = phi H, of 9.5 a H x^3 where x
is small.

Where a field is smooth the rule's own bound, H^4 / 720 int |f''''| dt, is often less than the bound by R, above all
near the box's faces, where the even continuation has a kink: in each block the lesser of the two is taken.

The deflection of a ray has an error from the slope of the same components. It changes the path in the second order of
the contrast or, where the stop is met at an angle, by the lever arm from there to the stop. The slope is at most
MISSED_SLOPE times the size for each cell; where this bound is too large the slope is computed from the high-passed
part.
"""

from dataclasses import dataclass
from functools import reduce

import numpy as np

from ..medium import IndexField
from ..medium.grid import UniformGrid
from .blocks import block_maxima, block_means, greatest_around, greatest_of_neighbors
from .high_pass import high_pass
from .path_through_blocks import along_axes, path_of
from .scheme import LOOKUP_STRIDE, MISSED_SLOPE
from .step_bound import block_size, potential_at_nodes, roughness_of_blocks
from .straight_lines import Lines, local_coordinates

# Frequencies along a ray, times H, from which on components are passed: along the ray, and at its ends.
EDGE, EDGE_AT_ENDS = 0.92, 0.4
# The error at an end over H |R| there, and the rule's own bound at an end over the bound elsewhere.
END, RULE_AT_ENDS = 0.5, 8.0
# The error over int |R| dt: one for the sum, and one for the integral.
BOTH = 2.0
# With fewer cells than this between samples, R is computed for this many and scaled: a spline's images have no end.
FINEST = 0.8
# Overshoot of a spline through one outstanding node between the next two nodes, at most, over the node's value.
LOBE = 0.15
# The greatest slope of a spline over the greatest difference of neighbouring nodes: sqrt(3) at nodes.
STEEPER = 1.75
# Greatest value of the end-corrected midpoint rule's Peano kernel, the Bernoulli polynomial of degree 4 over 4!.
PEANO = 1.0 / 720.0
# Components of a direction below which no neighbouring block is met within half a stride.
LEAST_OBLIQUITY = 0.05
# Least component along an axis that all rays run along; greatest components along the other axes for which rays move by
# less than a cell in a block.
LEAST_MAIN, LEVEL = 0.7, 0.25
# Blocks along that axis over which a lookup averages; strides are shorter where a ray ends and find fewer of them.
LOOKED_OVER, LOOKED_SHORT = 3, 1.1
# Ends of rays count where the potential over the length of a block exceeds this share of the tolerance.
ENDS_SHARE = 0.02

# Tables of blocks cached on a grid: a few for each sample count that is tried for a bundle, and some bundles.
CACHED = 32  # speed only


@dataclass(frozen=True)
class Sampling:
    """How a bundle is sampled.

    Attributes:
        spacing: Greatest distance of a ray's samples [m].
        steepness: Greatest absolute value of each component of the rays' unit vectors.
        lever_arm: Change of the path by an error of direction where the stop is met at a right angle [m/rad].
        is_fine: Whether rounding to single precision would be visible in the bound.
        ends: Blocks in which rays begin or end in disturbed air, see `disturbed_ends`; empty where they do not.
    """

    spacing: float
    steepness: tuple[float, float, float]
    lever_arm: float
    is_fine: bool = True
    ends: bytes = b""


def disturbed_ends(field: IndexField, lines: Lines, limit: float) -> bytes:
    """Blocks around those in which lines begin or end in disturbed air, as packed bits; empty if there are none.

    Args:
        field: A field on a cubic uniform grid.
        lines: The rays' straight lines through the support of the field.
        limit: The OPD error allowed to them [m].
    """
    grid = field.samples
    assert isinstance(grid, UniformGrid)
    worth = _potential_by_blocks(grid) * float((block_size(grid) * np.asarray(grid.spacing)).max())
    key = "blocks of ends", field.geometry, worth.shape, _nodes_key(grid)
    near = lines.derive(key, lambda: _blocks_of_ends(grid, field.geometry, lines, worth.shape))
    near = near * (worth > ENDS_SHARE * limit)
    return np.packbits(near).tobytes() if near.any() else b""


def _nodes_key(grid: UniformGrid) -> tuple[bytes, bytes]:
    """What of a grid, besides its shape, decides which blocks a line crosses."""
    return np.asarray(grid.low).tobytes(), np.asarray(grid.spacing).tobytes()


def _blocks_of_ends(grid: UniformGrid, geometry: str, lines: Lines, shape: tuple[int, ...]) -> np.ndarray:
    """1 in the blocks in which lines begin or end and in the adjacent blocks, 0 elsewhere."""
    near = np.zeros(shape, dtype=np.uint8)
    size = block_size(grid) * np.asarray(grid.spacing)
    ends = np.concatenate([lines.start, lines.start + lines.length[:, None] * lines.direction])
    entry = np.floor((local_coordinates(ends, geometry) - grid.low) / size).astype(int)
    near[tuple(np.clip(entry, 0, np.array(near.shape) - 1).T)] = 1
    for axis in range(near.ndim):
        near = greatest_around(near, -1, 1, axis)
    return near


def _potential_by_blocks(grid: UniformGrid) -> np.ndarray:
    """Greatest absolute potential over the ambient index in each block."""
    return grid.derive("potential by blocks", lambda: block_maxima(np.abs(potential_at_nodes(grid)), block_size(grid)))


def missed_in_blocks(field: IndexField, sampling: Sampling, by_rule: bool = False) -> tuple[int, np.ndarray]:
    """Cells in a block, and for each block the greatest error of a ray's path per metre of path in it [1].

    Args:
        field: A field on a cubic uniform grid.
        sampling: How its rays are sampled.
        by_rule: Take the rule's own bound, which is faster to compute and never less.
    """
    grid = field.samples
    assert isinstance(grid, UniformGrid)
    key = ("missed by rule" if by_rule else "missed", field.geometry, sampling)
    return grid.derive(key, lambda: _missed(grid, field.geometry, sampling, by_rule), CACHED)


def lookup_table(field: IndexField, sampling: Sampling) -> tuple[int, np.ndarray]:
    """Cells in a block, and the table in which kernels look up the error once within a stride of a ray."""
    from scipy.ndimage import uniform_filter1d

    block, missed = missed_in_blocks(field, sampling)
    obliquities, main = along_axes(sampling.steepness, field.geometry), _main_axis(sampling.steepness, field.geometry)
    for axis, obliquity in enumerate(obliquities):
        if axis == main:
            missed = LOOKED_SHORT * uniform_filter1d(missed, LOOKED_OVER, axis=axis, mode="nearest")
        elif obliquity > LEAST_OBLIQUITY:
            # Blocks that are found a block and a half away along the main axis are beside the ray by that slope.
            wide = 3 if main is None or obliquity < 0.5 * obliquities[main] else 5
            missed = greatest_around(missed, -(wide // 2), wide // 2, axis)
    return block, missed


def greatest_error(
    field: IndexField, sampling: Sampling, lines: Lines, by_rule: bool = False, allowed: float = np.inf
) -> float:
    """Bound the path error of any ray by structure between its samples [m].

    Args:
        field: A field on a cubic uniform grid.
        sampling: How its rays are sampled.
        lines: Their straight lines through the support of the field.
        by_rule: See `missed_in_blocks`.
        allowed: A bound above this is refined: the change of the missed structure across the rays is computed.
    """
    grid = field.samples
    assert isinstance(grid, UniformGrid)
    block, missed = missed_in_blocks(field, sampling, by_rule)
    changes = MISSED_SLOPE / float(np.min(field.spacing)) * missed if lines.lever_arm.any() else None
    found = _greatest_on_lines(grid, block, missed, changes, lines, field.geometry)
    if found > allowed and changes is not None and not (by_rule or sampling.ends):
        key = "changes missed", field.geometry, sampling
        sharper = grid.derive(key, lambda: _changes(grid, field.geometry, sampling), CACHED)
        changes = np.minimum(sharper, changes)
        found = min(found, _greatest_on_lines(grid, block, missed, changes, lines, field.geometry))
    return found


def _greatest_on_lines(
    grid: UniformGrid, block: int, missed: np.ndarray, changes: np.ndarray | None, lines: Lines, geometry: str
) -> float:
    """Greatest sum along any line of the error `missed` in blocks, and of its `changes` times the lever arms.

    None for `changes` means that no line has a lever arm.
    """
    key = "path", geometry, block, missed.shape, _nodes_key(grid)
    path = lines.derive(key, lambda: path_of(grid, block, missed.shape, lines, geometry))
    met, changing = missed[path.part], None if changes is None else changes[path.part]
    found = float(met.max()) * path.longest
    if changing is not None:
        found += float(changing.max()) * path.lever_arm * path.longest
    # Along an axis that all rays run along: layer by layer, as far to the side as a ray may get.
    for layers in path.layers:
        amount = met if changing is None else met + changing * layers.lever_arms
        for other, count in layers.beside:
            amount = greatest_of_neighbors(amount, count, other)
        found = min(found, float(amount.sum(axis=layers.axis).max()) * layers.thickness / layers.least)
    return found


def missed_along(field: IndexField, sampling: Sampling, lines: Lines) -> np.ndarray:
    """Error of straight rays by structure between samples, by the kernels' own lookup [m], shape (line_count,)."""
    block, table = lookup_table(field, sampling)
    size = block * np.asarray(field.samples.spacing)
    count = max(1, int(np.ceil(float(lines.length.max(initial=0.0)) / (LOOKUP_STRIDE * float(size.min())))))
    found = np.zeros(len(lines.length))
    for k in range(count):
        place = lines.start + ((k + 0.5) / count * lines.length)[:, None] * lines.direction
        entry = np.floor((local_coordinates(place, field.geometry) - field.samples.low) / size).astype(int)
        found += table[tuple(np.clip(entry, 0, np.array(table.shape) - 1).T)]
    return found * lines.length / count * _with_lever_arm(field, lines)


def _with_lever_arm(field: IndexField, lines: Lines) -> np.ndarray:
    """The factor by which an error of the path grows with the error of direction that comes with it."""
    return 1.0 + MISSED_SLOPE / float(np.min(field.spacing)) * lines.lever_arm


def _missed(grid: UniformGrid, geometry: str, sampling: Sampling, by_rule: bool) -> tuple[int, np.ndarray]:
    block = block_size(grid)
    missed = grid.derive(("missed by rule itself", geometry, sampling), lambda: _by_rule(grid, geometry, sampling), 2)
    factor = 1.0 + MISSED_SLOPE * sampling.lever_arm / float(grid.spacing.min())
    if by_rule:
        return block, factor * missed * (RULE_AT_ENDS if sampling.ends else 1.0)
    parts, spacing, share = _not_resolved(grid, geometry, sampling)
    rest = _by_blocks(grid, geometry, sampling, np.abs(parts[0]))
    main = _main_axis(sampling.steepness, geometry)
    if sampling.ends:
        is_end = _ends_of(grid, sampling)
        length = block * float(grid.spacing.min() if main is None else grid.spacing[main])
        rest = rest + is_end * (END / BOTH * spacing / length) * block_maxima(np.abs(parts[1]), block)
        missed = missed * np.where(is_end, RULE_AT_ENDS, 1.0)
    missed = np.minimum(missed, BOTH * share * _with_lobes(rest, main))
    return block, factor * missed


def _by_rule(grid: UniformGrid, geometry: str, sampling: Sampling) -> np.ndarray:
    """The rule's own bound in each block, per metre of path [1]."""
    obliquity = along_axes(sampling.steepness, geometry)
    _, fourth, _ = roughness_of_blocks(grid)
    strides = [PEANO * (u * sampling.spacing) ** 4 for u in obliquity]
    return _joined([stride * change for stride, change in zip(strides, fourth, strict=True)])


def _changes(grid: UniformGrid, geometry: str, sampling: Sampling) -> np.ndarray:
    """Greatest change of the missed potential across the rays in each block, per metre of path [1/m].

    It holds for rays that neither begin nor end in disturbed air.
    """
    parts, _, share = _not_resolved(grid, geometry, sampling)
    main = _main_axis(sampling.steepness, geometry)
    obliquity = along_axes(sampling.steepness, geometry)
    square = np.zeros_like(parts[0])
    for axis in range(square.ndim):
        # Along the axis that all rays run along, only the component across the rays counts.
        across = 1.0 if axis != main else min(1.0, float(np.linalg.norm(np.delete(obliquity, axis))))
        step = np.abs(np.diff(parts[0], axis=axis)) * square.dtype.type(across / grid.spacing[axis])
        none = [(0, 0)] * square.ndim
        before, behind = list(none), list(none)
        before[axis], behind[axis] = (1, 0), (0, 1)
        square += np.maximum(np.pad(step, before), np.pad(step, behind)) ** 2
    rest = _by_blocks(grid, geometry, sampling, np.sqrt(square))
    return STEEPER * BOTH * share * _with_lobes(rest, main)


def _not_resolved(grid: UniformGrid, geometry: str, sampling: Sampling) -> tuple[list[np.ndarray], float, float]:
    """The parts of the potential at nodes that samples some distance apart do not resolve: along rays, and at ends.

    Also returns that distance [m], and the share of these parts that counts.
    """
    obliquity = along_axes(sampling.steepness, geometry)
    # At higher frequencies a spline's images fall off as the fourth power of the frequency.
    finest = FINEST / max(float((obliquity / grid.spacing).max()), 1.0 / float((grid.high - grid.low).max()))
    spacing, share = max(sampling.spacing, finest), min(sampling.spacing / finest, 1.0) ** 4
    edges = (EDGE, EDGE_AT_ENDS) if sampling.ends else (EDGE,)
    key = ("not resolved", geometry, sampling)

    def find() -> list[np.ndarray]:
        return high_pass(grid, obliquity, spacing, edges, sampling.is_fine, _ends_of(grid, sampling))

    return grid.derive(key, find, 1), spacing, share


def _ends_of(grid: UniformGrid, sampling: Sampling) -> np.ndarray:
    """Whether rays begin or end in disturbed air in each block, or beside it."""
    shape = tuple((count - 2) // block_size(grid) + 1 for count in grid.shape)
    if not sampling.ends:
        return np.zeros(shape, np.uint8)
    return np.unpackbits(np.frombuffer(sampling.ends, np.uint8), count=int(np.prod(shape))).reshape(shape)


def _by_blocks(grid: UniformGrid, geometry: str, sampling: Sampling, size: np.ndarray) -> np.ndarray:
    """Greatest mean that a ray meets on its path through each block, of sizes at nodes, along the rays' main axis."""
    block = block_size(grid)
    obliquity, main = along_axes(sampling.steepness, geometry), _main_axis(sampling.steepness, geometry)
    across = [axis for axis in range(len(obliquity)) if axis != main]
    if main is None:
        return block_maxima(size, block)
    if obliquity[across].max(initial=0.0) > LEVEL:
        return block_means(block_maxima(size, block, across), block, main)
    return block_maxima(block_means(size, block, main), block, across)


def _with_lobes(rest: np.ndarray, main: int | None) -> np.ndarray:
    """Values of blocks, raised to the overshoot of their neighbours' splines into them."""
    for axis in range(rest.ndim):
        if axis != main:
            rest = np.maximum(rest, LOBE * greatest_around(rest, -1, 1, axis))
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
