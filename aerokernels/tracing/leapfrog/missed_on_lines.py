"""What the rays of a bundle miss between leapfrog samples, by their straight lines and the tables of unresolved.py."""

from dataclasses import dataclass

import numpy as np

from aerokernels.tracing.tasks.unresolved import (
    EVERYWHERE,
    Sampling,
    along_axes,
    changes_missed,
    lookup_table,
    missed_at_ends,
    missed_in_blocks,
    potential_by_blocks,
    with_neighbors,
)

from ...derived import cached_on
from ...medium import IndexField
from ...medium.grid import UniformGrid, local_coordinates
from ..blocks import greatest_of_neighbors
from ..scheme import LOOKUP_STRIDE, MISSED_SLOPE
from ..step_bound import block_size
from ..straight_lines import Lines, local_range

# Ends of rays count where the potential over the length of a block exceeds this share of the tolerance.
ENDS_SHARE = 0.02


@dataclass(frozen=True, eq=False)
class Layers:
    """Layers of blocks across an axis that all lines run along, `thickness` [m].

    With the greatest lever arm of a line from its entry into each layer [m], the number of adjacent blocks `beside` it
    that a ray may meet there by the other axes, and the least component of a line's direction along the axis.
    """

    axis: int
    lever_arms: np.ndarray
    beside: tuple[tuple[int, int], ...]
    thickness: float
    least: float


@dataclass(frozen=True, eq=False)
class BlockPath:
    """The blocks that lines pass, with one more to each side, the greatest length and lever arm [m], and their layers.

    There are layers for each axis that all lines run along, the one that they run along most first.
    """

    part: tuple[slice, ...]
    longest: float
    lever_arm: float
    layers: tuple[Layers, ...]


def disturbed_ends(field: IndexField, lines: Lines, limit: float) -> bytes:
    """Blocks around those in which lines begin or end in disturbed air, as packed bits; empty if there are none.

    For a volume, of which all blocks are examined at once, the answer is EVERYWHERE instead: bundles then share tables.
    """
    grid = field.samples
    assert isinstance(grid, UniformGrid)
    worth = potential_by_blocks(grid) * float((block_size(grid) * np.asarray(grid.spacing)).max())
    near = _blocks_of_ends(lines, field.geometry, grid.low, block_size(grid) * grid.spacing, worth.shape)
    near = near * (worth > ENDS_SHARE * limit)
    if not near.any():
        return b""
    return EVERYWHERE if near.ndim == 3 else np.packbits(near).tobytes()


@cached_on("lines", 2)
def _blocks_of_ends(
    lines: Lines, geometry: str, low: np.ndarray, size: np.ndarray, shape: tuple[int, ...]
) -> np.ndarray:
    """1 in the blocks in which lines begin or end and in the adjacent blocks, 0 elsewhere."""
    near = np.zeros(shape, dtype=np.uint8)
    for end in _ends_of_lines(lines, geometry, low, size, shape):
        near[end] = 1
    return with_neighbors(near)


@cached_on("lines", 2)
def _ends_of_lines(
    lines: Lines, geometry: str, low: np.ndarray, size: np.ndarray, shape: tuple[int, ...]
) -> list[tuple]:
    """The blocks in which lines begin, and in which they end, each as an index."""
    places = lines.start, lines.start + lines.length[:, None] * lines.direction
    return [_blocks_at(place, geometry, low, size, shape) for place in places]


def _blocks_at(place: np.ndarray, geometry: str, low: np.ndarray, size: np.ndarray, shape: tuple[int, ...]) -> tuple:
    """The blocks of a size [m] that begin at `low` [m] at some places (n, 3) [m], as an index."""
    entry = np.floor((local_coordinates(place, geometry) - low) / size).astype(int)
    return tuple(np.clip(entry, 0, np.array(shape) - 1).T)


def greatest_error(
    field: IndexField,
    sampling: Sampling,
    lines: Lines,
    by_rule: bool = False,
    allowed: float = np.inf,
    show_ends: bool = True,
) -> float:
    """Bound the path error of any ray by structure between its samples [m].

    A bound above `allowed` is refined by the change of the missed structure across the rays, unless `by_rule`. Rays
    begin and end where the lines do or, without `show_ends`, anywhere between the outermost of these.
    """
    grid = field.samples
    assert isinstance(grid, UniformGrid)
    block, missed = missed_in_blocks(field, sampling, by_rule)
    changes = MISSED_SLOPE / float(np.min(field.spacing)) * missed if lines.lever_arm.any() else None
    ends = _greatest_at_ends(field, sampling, lines, by_rule, show_ends)
    found = _greatest_on_lines(grid, block, missed, changes, lines, field.geometry)
    if found + ends > allowed and changes is not None and not by_rule:
        changes = np.minimum(changes_missed(field, sampling), changes)
        found = min(found, _greatest_on_lines(grid, block, missed, changes, lines, field.geometry))
    return found + ends


def _greatest_at_ends(field: IndexField, sampling: Sampling, lines: Lines, by_rule: bool, show_ends: bool) -> float:
    """Greatest error by structure at both ends of any ray [m]; see `greatest_error`."""
    if show_ends:
        return float(_missed_at_ends_of(field, sampling, lines, by_rule).max(initial=0.0))
    at_ends = missed_at_ends(field, sampling, by_rule)
    if at_ends is None or not len(lines.length):
        return 0.0
    found = 0.0
    for places in known_ends(field, lines, at_ends.shape):
        part = tuple(slice(int(place.min()), int(place.max()) + 1) for place in places)
        found += float(at_ends[part].max())
    return found * float(with_lever_arm(field, lines).max())


def _missed_at_ends_of(field: IndexField, sampling: Sampling, lines: Lines, by_rule: bool = False) -> np.ndarray:
    """Error of straight rays by structure at both of their ends [m], shape (line_count,)."""
    at_ends = missed_at_ends(field, sampling, by_rule)
    if at_ends is None:
        return np.zeros(len(lines.length))
    first, last = known_ends(field, lines, at_ends.shape)
    found: np.ndarray = (at_ends[first] + at_ends[last]) * with_lever_arm(field, lines)
    return found


def known_ends(field: IndexField, lines: Lines, shape: tuple[int, ...]) -> list[tuple]:
    """The blocks of a field in which lines begin, and in which they end; cached."""
    grid = field.samples
    assert isinstance(grid, UniformGrid)
    return _ends_of_lines(lines, field.geometry, grid.low, block_size(grid) * grid.spacing, shape)


def _greatest_on_lines(
    grid: UniformGrid,
    block: int,
    missed: np.ndarray,
    changes: np.ndarray | None,
    lines: Lines,
    geometry: str,
) -> float:
    """Greatest sum along any line of the error `missed` in blocks, and of its `changes` times the lever arms."""
    path = path_of(lines, geometry, grid.low, block * grid.spacing, missed.shape)
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
    grid, (block, table) = field.samples, lookup_table(field, sampling)
    assert isinstance(grid, UniformGrid)
    size = block * np.asarray(grid.spacing)
    count = max(1, int(np.ceil(float(lines.length.max(initial=0.0)) / (LOOKUP_STRIDE * float(size.min())))))
    found = np.zeros(len(lines.length))
    for k in range(count):
        place = lines.start + ((k + 0.5) / count * lines.length)[:, None] * lines.direction
        found += table[_blocks_at(place, field.geometry, grid.low, size, table.shape)]
    found *= lines.length / count * with_lever_arm(field, lines)
    return found + _missed_at_ends_of(field, sampling, lines)


def with_lever_arm(field: IndexField, lines: Lines) -> np.ndarray:
    """The factor by which an error of the path grows with the error of direction that comes with it."""
    return 1.0 + MISSED_SLOPE / float(np.min(field.spacing)) * lines.lever_arm


# Blocks by which a ray may be deflected sideways, in addition to the drift of its straight line.
DEFLECTED = 0.5


@cached_on("lines", 2)
def path_of(lines: Lines, geometry: str, low: np.ndarray, size: np.ndarray, shape: tuple[int, ...]) -> BlockPath:
    """The path of lines through a grid's blocks: their size [m], numbers along the axes, and lowest corner [m]."""
    local = local_range(lines, geometry)
    # One block more to each side, for the deflection of rays and for rays between those of `lines`.
    first = np.clip(np.floor((local[0] - low) / size).astype(int) - 1, 0, np.array(shape) - 1)
    last = np.clip(np.floor((local[1] - low) / size).astype(int) + 1, first, np.array(shape) - 1)
    part = tuple(slice(begin, end + 1) for begin, end in zip(first.tolist(), last.tolist(), strict=True))
    longest = float(lines.length.max(initial=0.0))
    components = np.abs(lines.direction[:, 3 - len(shape) :])
    drift = along_axes(np.abs(lines.direction).max(axis=0, initial=0.0), geometry) * longest / size
    layers = []
    for axis in range(geometry == "axisymmetric", len(shape)):
        least = float(components[:, axis].min(initial=1.0))
        if least * longest > size[axis]:  # otherwise a sum over layers bounds no better than the greatest value
            faces = low[axis] + (first[axis] + np.arange(last[axis] - first[axis] + 2)) * size[axis]
            levers = _lever_arms_from(lines, faces, axis + 3 - len(shape))
            others = [other for other in range(len(shape)) if other != axis]
            beside = tuple((other, 1 + int(np.ceil(drift[other] + DEFLECTED))) for other in others)
            levers = levers.reshape([-1 if other == axis else 1 for other in range(len(shape))])
            layers.append(Layers(axis, levers, beside, float(size[axis]), least))
    layers.sort(key=lambda each: -each.least)  # the axis along which lines run most gives the least bound
    return BlockPath(part, longest, float(lines.lever_arm.max(initial=0.0)), tuple(layers))


def _lever_arms_from(lines: Lines, faces: np.ndarray, component: int) -> np.ndarray:
    """The greatest lever arm of any line from its entry into each layer between planes across an axis [m]."""
    start, rate = lines.start[:, component].copy(), 1.0 / lines.direction[:, component]
    levers = np.zeros(len(faces) - 1)
    if not len(start):
        return levers
    before = (faces[0] - start) * rate
    for layer, face in enumerate(faces[1:]):
        behind = (face - start) * rate
        nearest = np.minimum(np.maximum(np.minimum(before, behind), 0.0), lines.length)
        levers[layer] = max((lines.lever_arm - lines.tangent * nearest).max(), 0.0)
        before = behind
    return levers
