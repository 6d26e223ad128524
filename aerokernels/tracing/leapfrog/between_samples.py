"""Bound the structure that a bundle's rays miss between leapfrog samples, and find how many samples suffice."""

import math

import numpy as np

from aerokernels.tracing.tasks.unresolved import Sampling

from ...medium import IndexField
from ...rays import RayBundle
from ..error_limit import path_exceeds, support_box
from ..straight_lines import LeverArms, lines_through
from .missed_on_lines import disturbed_ends, greatest_error, missed_along

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
# Power of the number of samples with which the error falls at first.
FIRST_ORDER = 8.0  # speed only
# Number of lines from which the share of rejected rays is estimated.
COUNTED_LINES = 1024
# Rounding to single precision is visible in a bound for tolerances below this share of the field's greatest OPD.
FINE_SHARE = 3e-5
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
        self.length, self.steepness = _rounded_length(self.lines.length), _rounded_steepness(self.lines.direction)
        if leaves_steepest and rays.ray_count > SPREAD_RAYS:
            self.steepness = _of_nearly_all(rays.direction, self.steepness)

    def sampled(self, count: int) -> Sampling:
        """How so many samples are distributed along the rays."""
        is_fine = path_exceeds(self.field, self.limit / FINE_SHARE)
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
            some = self.lines.every(max(1, len(self.lines.length) // COUNTED_LINES))
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
            guess = multiple_of_three(tried * (found / allowed) ** (1.0 / FIRST_ORDER))
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


def _rounded_length(lengths: np.ndarray) -> float:
    """A length that no ray of the bundle exceeds, given those of examined rays; 0 where there are none."""
    longest = SPACING_MARGIN * float(lengths.max(initial=0.0))
    return 2.0 ** (math.floor(LENGTHS * math.log2(longest)) / LENGTHS) if longest > 0.0 else 0.0


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
