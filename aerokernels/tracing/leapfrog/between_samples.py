"""Bound the structure that a bundle's rays miss between leapfrog samples, and find how many samples suffice."""

import math
from dataclasses import dataclass

import numpy as np

from aerokernels.tracing.tasks.unresolved import (
    EVERYWHERE,
    Sampling,
    along_axes,
    changes_missed,
    grid_of,
    lookup_table,
    missed_at_ends,
    missed_in_blocks,
    potential_by_blocks,
    with_neighbors,
)

from ...derived import cached_on
from ...medium import IndexField
from ...medium.grid import UniformGrid, local_coordinates
from ...rays import RayBundle
from ..blocks import greatest_of_neighbors
from ..error_limit import path_exceeds, support_box
from ..lines import LeverArms, Lines, lines_through, local_range
from ..scheme import LOOKUP_STRIDE, MISSED_SLOPE
from ..step_bound import block_size

# Up to this factor more samples are taken in preference to computing the sharper bound of a field of two axes, and of a
# volume, for which that takes ten times as long.
A_FEW_MORE = {"planar": 1.25, "axisymmetric": 1.25, "volume": 1.5}

# The pilot's greatest error is kept MARGIN times below the tolerance. Structure between samples may use up the rest
# without being bounded for each ray.
MARGIN = 4.0
NEGLIGIBLE = 1.0 - 1.0 / MARGIN
# Otherwise counts are tried in steps of this factor; a ray is expected to be rejected from this share of the tolerance
# on.
FINER = 1.3
REJECTED = 0.7
# The longest of all rays may be this many times as long as the longest examined ray, less what is rounded off: lengths
# are rounded down to so many an octave.
SPACING_MARGIN, LENGTHS = 1.02, 64
# Greatest components of directions are rounded up to a multiple of a power of two: the least power that is no smaller
# than one of so many parts of their range.
PARTS = 16.0
# Number of a bundle's rays whose lines are examined, besides its outermost rays.
SPREAD_RAYS = 8192
# Rays whose directions have components above those of all but STEEPER of these, and above AND_MORE times these, may be
# traced again, if that leaves the others less steep than all by LESS_STEEP at least: of random slopes the steepest of a
# million would otherwise decide how many samples all take.
STEEPER, AND_MORE, LESS_STEEP = 16, 1.1, 0.8


class MissedStructure:
    """The structure that the rays of a bundle may miss between their samples."""

    def __init__(
        self,
        field: IndexField,
        rays: RayBundle,
        until,
        limit: float,
        lever_arms: LeverArms | None,
        pilot: RayBundle | None = None,
        leaves_steepest: bool = False,
    ):
        """Compute the lines through the field's support of rays that show the extent of the bundle there.

        If these are the `pilot`, they show where all rays begin and end. `limit` is the error allowed to them [m]. With
        `leaves_steepest` `steepness` need not hold for a few rays that are much steeper than the others.
        """
        self.field, self.limit = field, limit
        low, high = support_box(field, limit, lever_arms)
        self.show_ends = rays is pilot
        self.lines = lines_through(field, rays, until, low, high)
        self.ends = disturbed_ends(field, self.lines, limit) if len(self.lines.length) else b""
        self._errors: dict[int, float] = {}
        # Both are rounded, so that other rays of the same kind find the tables of these.
        longest = SPACING_MARGIN * float(self.lines.length.max(initial=0.0))
        self.length = 2.0 ** (math.floor(LENGTHS * math.log2(longest)) / LENGTHS) if longest > 0.0 else 0.0
        self.steepness = _rounded_steepness(self.lines.direction)
        if leaves_steepest and rays.ray_count > SPREAD_RAYS:
            self.steepness = _of_nearly_all(rays.direction, self.steepness)

    def sampled(self, count: int) -> Sampling:
        """How so many samples are distributed along the rays."""
        # Rounding to single precision is visible in a bound for tolerances below this share of the field's greatest
        # OPD.
        is_fine = path_exceeds(self.field, self.limit / 3e-5)
        return Sampling(self.length / count, self.steepness, self.lever_arm(self.limit), is_fine, self.ends)

    def lever_arm(self, limit: float) -> float:
        """That of a Sampling for an OPD error [m] allowed to a ray: a deflection still counts in second order."""
        return math.sqrt(0.5 * limit * self.length)

    def least_count(self, count: int, is_worth_it, cost_again) -> int:
        """The number of samples, at least `count`, with the least cost, including `cost_again()` for rejected rays."""
        best, best_cost = 0, math.inf
        before = 0, math.inf
        while is_worth_it(count) and count < best_cost:
            found = self._greatest(count)
            if found <= NEGLIGIBLE * self.limit:
                count = self._between_counts(before, (count, found))
                return count if count < best_cost else best
            # Number of lines from which the share of rejected rays is estimated.
            some = self.lines.every(max(1, len(self.lines.length) // 1024))
            missed = missed_along(self.field, self.sampled(count), some)
            rejected = float((missed > REJECTED * self.limit).mean())
            cost = count + (rejected * cost_again() if rejected > 0.0 else 0.0)
            if cost < best_cost:
                best, best_cost = count, cost
            before = count, found
            count = multiple_of_three(FINER * count)
        return best

    def enough(self, count: int, most: int) -> int:
        """The least number of samples from `count` to `most` that miss no structure; 0 where there is none."""
        found = self._greatest(count)
        if found <= NEGLIGIBLE * self.limit:
            return count
        found_most = self._greatest(most)
        enough = found_most <= NEGLIGIBLE * self.limit
        return self._between_counts((count, found), (most, found_most)) if enough else 0

    def fewest(self, count: int, most: int) -> int:
        """As `enough`, searched from below and one step at a time: the error at first falls faster than further on."""
        allowed = NEGLIGIBLE * self.limit
        tried, found = count, self._greatest(count)
        while found > allowed:
            if tried >= most:
                return 0
            # Power of the number of samples with which the error falls at first (speed only).
            guess = multiple_of_three(tried * (found / allowed) ** (1.0 / 8.0))
            tried = min(max(guess, tried + 3), most)
            found = self._greatest(tried)
        while tried - 3 > count and self._greatest(tried - 3) <= allowed:
            tried -= 3
        return tried

    def _between_counts(self, few: tuple[int, float], many: tuple[int, float]) -> int:
        """The number of samples between one too small and one sufficient, by a power law through both errors."""
        if few[0] and many[1] > 0.0:
            order = math.log(few[1] / many[1]) / math.log(many[0] / few[0])
            count = multiple_of_three(few[0] * (few[1] / (NEGLIGIBLE * self.limit)) ** (1.0 / order))
            if count < many[0] and self._greatest(count) <= NEGLIGIBLE * self.limit:
                return count
        return many[0]

    def _greatest(self, count: int) -> float:
        """The greatest error of any ray with this many samples [m]."""
        if not len(self.lines.length):
            return 0.0
        if count not in self._errors:
            allowed = NEGLIGIBLE * self.limit
            self._errors[count] = greatest_error(
                self.field, self.sampled(count), self.lines, allowed=allowed, show_ends=self.show_ends
            )
        return self._errors[count]

    def sufficient(self, count: int) -> int:
        """This number of samples, or a few more, that miss no structure; 0 where they would.

        The rule's own bound is taken if a few more samples suffice: they cost less than a sharper bound.
        """
        if not len(self.lines.length):
            return count
        allowed = NEGLIGIBLE * self.limit
        by_rule = greatest_error(self.field, self.sampled(count), self.lines, by_rule=True, show_ends=self.show_ends)
        if by_rule <= allowed:
            return count
        most = multiple_of_three(A_FEW_MORE[self.field.geometry] * count)
        more = multiple_of_three(count * (1.02 * by_rule / allowed) ** 0.25)  # it falls with the fourth power
        return more if more <= most else self.enough(count, most)

    def sampling(self, count: int) -> Sampling | None:
        """How this many samples are distributed along the rays; None where they miss no structure."""
        return None if self._greatest(count) <= NEGLIGIBLE * self.limit else self.sampled(count)


def _rounded_steepness(direction: np.ndarray) -> tuple[float, float, float]:
    """Bounds of the components of unit vectors (n, 3); those that all of them share are exact."""
    steepness = np.abs(direction).max(axis=0, initial=0.0)
    extent = np.ptp(direction, axis=0) if len(direction) else np.zeros(3)
    rounded = _rounded_up(steepness, extent)
    x, y, z = np.minimum(rounded, 1.0).tolist()
    return x, y, z


def _rounded_up(values: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    """Round values up to multiples of a power of two, see PARTS; those whose range is 0 stay."""
    with np.errstate(divide="ignore"):
        part = 2.0 ** np.ceil(np.log2(ranges / PARTS))
    return np.where(part > 0.0, np.ceil(values / np.where(part > 0.0, part, 1.0)) * part, values)


def _of_nearly_all(direction: np.ndarray, steepness: tuple[float, float, float]) -> tuple[float, float, float]:
    """Bounds of the components of nearly all unit vectors (n, 3), or `steepness` of all where these are close to it."""
    size = np.abs(direction[:SPREAD_RAYS])
    most = np.minimum(AND_MORE * np.partition(size, -STEEPER - 1, axis=0)[-STEEPER - 1], 1.0)
    rounded = np.minimum(_rounded_up(most, most), steepness)
    if (rounded >= LESS_STEEP * np.asarray(steepness)).all():
        return steepness
    x, y, z = rounded.tolist()
    return x, y, z


def multiple_of_three(count: float) -> int:
    """The next multiple of three."""
    return 3 * math.ceil(count / 3.0 - 1e-9)


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


def disturbed_ends(field: IndexField, lines: Lines, limit: float) -> bytes:
    """Blocks around those in which lines begin or end in disturbed air, as packed bits; empty if there are none.

    For a volume, of which all blocks are examined at once, the answer is EVERYWHERE instead: bundles then share tables.
    """
    grid = grid_of(field)
    worth = potential_by_blocks(grid) * float((block_size(grid) * np.asarray(grid.spacing)).max())
    near = np.zeros(worth.shape, dtype=np.uint8)
    for end in known_ends(field, lines, worth.shape):
        near[end] = 1
    # Ends of rays count where the potential over the length of a block exceeds this share of the tolerance.
    near = with_neighbors(near) * (worth > 0.02 * limit)
    if not near.any():
        return b""
    return EVERYWHERE if near.ndim == 3 else np.packbits(near).tobytes()


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
    grid = grid_of(field)
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
    grid = grid_of(field)
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
    part, layers_of_axes = path_of(lines, geometry, grid.low, block * grid.spacing, missed.shape)
    met, changing = missed[part], None if changes is None else changes[part]
    longest = float(lines.length.max(initial=0.0))
    found = float(met.max()) * longest
    if changing is not None:
        found += float(changing.max()) * float(lines.lever_arm.max(initial=0.0)) * longest
    # Along an axis that all rays run along: layer by layer, as far to the side as a ray may get.
    for layers in layers_of_axes:
        amount = met if changing is None else met + changing * layers.lever_arms
        for other, count in layers.beside:
            amount = greatest_of_neighbors(amount, count, other)
        found = min(found, float(amount.sum(axis=layers.axis).max()) * layers.thickness / layers.least)
    return found


def missed_along(field: IndexField, sampling: Sampling, lines: Lines) -> np.ndarray:
    """Error of straight rays by structure between samples, by the kernels' own lookup [m], shape (line_count,)."""
    grid, (block, table) = grid_of(field), lookup_table(field, sampling)
    size = block * np.asarray(grid.spacing)
    count = max(1, int(np.ceil(float(lines.length.max(initial=0.0)) / (LOOKUP_STRIDE * float(size.min())))))
    share = ((np.arange(count) + 0.5) / count)[:, None]
    places = lines.start + (share * lines.length)[..., None] * lines.direction
    met = table[_blocks_at(places.reshape(-1, 3), field.geometry, grid.low, size, table.shape)]
    found = met.reshape(count, -1).sum(axis=0) * (lines.length / count * with_lever_arm(field, lines))
    return found + _missed_at_ends_of(field, sampling, lines)


def with_lever_arm(field: IndexField, lines: Lines) -> np.ndarray:
    """The factor by which an error of the path grows with the error of direction that comes with it."""
    return 1.0 + MISSED_SLOPE / float(np.min(field.spacing)) * lines.lever_arm


@cached_on("lines", 2)
def path_of(
    lines: Lines, geometry: str, low: np.ndarray, size: np.ndarray, shape: tuple[int, ...]
) -> tuple[tuple[slice, ...], list[Layers]]:
    """The blocks of a size [m] that lines pass, with one more to each side, and their layers along axes.

    There are layers for each axis that all lines run along, the one that they run along most first.
    """
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
            # Blocks by which a ray may be deflected sideways, in addition to the drift of its straight line.
            beside = tuple((other, 1 + int(np.ceil(drift[other] + 0.5))) for other in others)
            levers = levers.reshape([-1 if other == axis else 1 for other in range(len(shape))])
            layers.append(Layers(axis, levers, beside, float(size[axis]), least))
    layers.sort(key=lambda each: -each.least)  # the axis along which lines run most gives the least bound
    return part, layers


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
