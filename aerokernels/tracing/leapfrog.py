"""How many leapfrog samples a bundle of nearly straight rays takes, see engines/warp/kernels/leapfrog.py.

A pilot of some of the rays is traced with N, 3 N and 9 N samples. From their differences follow the order of
convergence and the least N that holds the tolerance; the pilot is traced with this N too and compared with the finest.
Each ray's own error estimate, which costs nothing, is scaled so that it covers the pilot's errors with a margin for the
other rays. Rays whose estimate is above the tolerance even so are traced again (retrace.py).
"""

import math
from dataclasses import replace

import numpy as np

from ..device_arrays import extremes_of, on_host
from ..medium import IndexField
from ..medium.grid import UniformGrid
from ..rays import RayBundle
from .engines import engine_of
from .grid_tables import prepare_grid
from .held import greatest_path, held_error
from .launch import launch
from .lever_arms import LeverArms, lever_arms_of
from .plan import TracePlan
from .prediction import predict_evaluations
from .status import reached
from .stop import ArcLength
from .straight_lines import lines_through
from .support import support_box
from .unresolved import Sampling, disturbed_ends, greatest_error, missed_along

# Fewer rays are traced under error control at once: a pilot would not pay.
LEAST_RAYS = 4096
PILOT_RAYS = 512
# Greatest distance of samples in cells. What lies between them is bounded from the field as well.
WIDEST = 6.0
LEAST_SAMPLES = 36
# Up to CHEAP samples leapfrog is always taken. Above that it is taken where the samples are at most WORTH times the
# evaluations predicted for error control: a sample costs less than an evaluation, much less on OpenCL, where the lanes
# of a CPU share it.
CHEAP = {"opencl": 450, "warp": 120}
WORTH = {"opencl": 5.0, "warp": 1.2}
MOST_SAMPLES = 3000
# The pilot's greatest error is held MARGIN times below the tolerance, and a ray's estimate is SAFETY times the pilot's.
MARGIN = 4.0
SAFETY = 3.0
# The error as a share of the difference from the sum over every third sample: for order 4, which is the rule's own, and
# for order 2.
LEAST_SHARE, GREATEST_SHARE = 1.0 / 80.0, 1.0 / 8.0
# The trajectory error as a share of int P^2 / p_t dt: it is never greater than what bending adds to the path.
GREATEST_BEND = 0.5
# The share of the pilot's rays that may be unfit for leapfrog.
UNFIT = 0.1

# So many more samples than a field before are taken rather than a closer look at a field.
A_FEW_MORE = 1.25

# What lies between samples may cost this share of the tolerance, the rest of which is the pilot's, without being
# bounded for each ray.
NEGLIGIBLE = 1.0 - 1.0 / MARGIN
# Elsewhere counts are tried in steps of this factor; a ray is expected to be rejected from this share of the tolerance
# on.
FINER = 1.3
REJECTED = 0.7
# Single precision is seen in a bound for tolerances below this share of the field's greatest optical path difference.
FINE_SHARE = 3e-5
# The longest of all rays may be this many times as long as the longest of those looked at.
SPACING_MARGIN = 1.02
# Rays of a bundle whose lines are looked at.
SPREAD_RAYS = 8192


def may_be_leapfrog(field: IndexField, ray_count: int, until) -> bool:
    """Whether this many rays may take leapfrog samples: on a cubic uniform grid, out of the box or to a plane."""
    if not (isinstance(field.samples, UniformGrid) and field.interpolation == "cubic"):
        return False
    return ray_count >= LEAST_RAYS and not isinstance(until, ArcLength)


def pilot_of(rays: RayBundle) -> RayBundle:
    """Some of the rays, evenly spread over the bundle's order."""
    rows = np.linspace(0, rays.ray_count - 1, min(PILOT_RAYS, rays.ray_count)).round().astype(int)
    return rays.rows(rows)


def spread_of(rays: RayBundle) -> RayBundle:
    """More of the rays, with the outermost in place and direction among them."""
    if rays.ray_count <= SPREAD_RAYS:
        return rays
    rows = np.linspace(0, rays.ray_count - 1, SPREAD_RAYS).round().astype(int)
    return rays.rows(np.concatenate([rows, *(extremes_of(rays.held(name)).rows for name in ("position", "direction"))]))


def fit_leapfrog(
    field: IndexField,
    pilot: RayBundle,
    plan: TracePlan,
    until,
    wavelength: float,
    spread,
    like: TracePlan | None = None,
) -> TracePlan | None:
    """The plan with the number of leapfrog samples that holds its tolerance; None where error control costs less.

    Args:
        field: One that `may_be_leapfrog`.
        pilot: Some of the rays.
        plan: Backend, device, precision and tolerance; method "leapfrog".
        until: The stop.
        wavelength: Vacuum wavelength [m].
        spread: Makes enough of the rays to show where the bundle goes.
        like: A plan of such rays through a field like this one: its number is taken where the pilot confirms it.
    """
    stop = None if until is None else (until.point.tobytes(), until.normal.tobytes())
    bundle = hash((pilot.position.tobytes(), pilot.direction.tobytes()))
    plan = replace(plan, lever_arms=lever_arms_of(field, pilot, until))
    key = ("leapfrog", bundle, stop, plan.tolerance, wavelength, plan.backend, plan.device, plan.precision)
    given = field, pilot, plan, until, wavelength, spread()
    fitted = None
    if like is not None and like.sample_count:
        fitted = field.derive(("confirmed", *key[1:], like.sample_count), lambda: _confirm(*given, like.sample_count))
    if fitted is None:
        fitted = field.derive(key, lambda: _fit(*given))
    count, shares, worst, sampling = fitted
    if not count:
        return None
    reason = (
        f"method leapfrog: {count} leapfrog samples a ray, bending included; a pilot of {pilot.ray_count} rays is "
        f"right to {worst / wavelength:.1g} waves; rays whose own error estimate is above the tolerance are "
        "traced again"
    )
    if sampling is not None:
        reason += "; the field has structure between samples, so what each ray may miss is bounded along its path"
    return replace(
        plan,
        sample_count=count,
        quadrature_error_scale=shares[0],
        trajectory_error_scale=shares[1],
        sampling=sampling,
        reasons=(reason, *plan.reasons),
        predicted_evaluations=float(count),
        predicted_error=worst / wavelength,
    )


def _fit(
    field: IndexField, pilot: RayBundle, plan: TracePlan, until, wavelength: float, spread: RayBundle
) -> tuple[int, tuple, float, Sampling | None]:
    """Samples of each ray (0: no number fits), the scales of its error estimate, and the pilot's greatest error [m].

    The last entry says how far apart the samples are, where what lies between them counts.
    """
    held = held_error(field, plan.tolerance * wavelength)
    budget = held / MARGIN
    nothing = 0, (), 0.0, None
    least = _least_samples(field, pilot, held, plan.lever_arms)
    if not _is_worth_it(field, pilot, plan, wavelength, least):
        return nothing
    levels = [_Level(field, pilot, plan, until, wavelength, least * 3**power) for power in range(3)]
    if not levels[-1].is_fit:
        return nothing
    first, second = levels[0].error(levels[1]), levels[1].error(levels[2])
    order = 1.0
    if second > 0.0:
        order = min(max(math.log(first / second) / math.log(3.0), 1.0), 4.0) if first > second else 1.0
    count = _in_threes(least * max(1.0, (first / budget) ** (1.0 / order))) if first > 0.0 else least
    between = _Between(field, spread, until, held, plan.lever_arms)
    count = between.least_count(
        count,
        lambda count: _is_worth_it(field, pilot, plan, wavelength, count),
        lambda: max(CHEAP[plan.backend], WORTH[plan.backend] * predict_evaluations(field, held, pilot.direction)),
    )
    while count and _is_worth_it(field, pilot, plan, wavelength, count):
        level = next((level for level in levels if level.count == count), None)
        if level is None:
            level = _Level(field, pilot, plan, until, wavelength, count)
        finest = levels[-1]
        if 2 * count > finest.count:
            finest = _Level(field, pilot, plan, until, wavelength, 3 * count)
            levels.append(finest)
        worst = level.error(finest)
        if level.is_fit and worst <= budget:
            shares = _shares(field, pilot, plan, until, wavelength, level, worst)
            return count, shares, worst, between.sampling(count)
        count = _in_threes(1.25 * count)
    return nothing


def _confirm(
    field: IndexField, pilot: RayBundle, plan: TracePlan, until, wavelength: float, spread: RayBundle, count: int
) -> tuple[int, tuple, float, Sampling | None] | None:
    """What `_fit` returns, for this number of samples; None where it does not hold, or rays may miss what counts."""
    assert isinstance(field.samples, UniformGrid)
    prepare_grid(engine_of(plan.backend, plan.device), field.samples)
    held = held_error(field, plan.tolerance * wavelength)
    if count < _least_samples(field, pilot, held, plan.lever_arms):
        return None
    count = _Between(field, spread, until, held, plan.lever_arms).sufficient(count)
    if not count:
        return None
    level, finest = (_Level(field, pilot, plan, until, wavelength, number) for number in (count, 3 * count))
    worst = level.error(finest)
    if not (level.is_fit and finest.is_fit and worst <= held / MARGIN):
        return None
    return count, _shares(field, pilot, plan, until, wavelength, level, worst), worst, None


def _shares(
    field: IndexField, pilot: RayBundle, plan: TracePlan, until, wavelength: float, level: "_Level", worst: float
) -> tuple[float, float]:
    """The scales of a ray's own error estimate, by which it covers the pilot's greatest error [m]."""
    share = SAFETY * worst / level.difference if level.difference > 0.0 else GREATEST_SHARE
    bending = replace(plan, trajectory_error_scale=1.0)
    bends = _Level(field, pilot, bending, until, wavelength, level.count, 0.0).difference
    trajectory_error_scale = SAFETY * worst / bends if bends > 0.0 else 0.0
    return min(max(share, LEAST_SHARE), GREATEST_SHARE), min(trajectory_error_scale, GREATEST_BEND)


class _Between:
    """What the rays of a bundle may miss between their samples."""

    def __init__(self, field: IndexField, spread: RayBundle, until, held: float, lever_arms: LeverArms | None):
        self.field, self.held = field, held
        low, high = support_box(field, held, lever_arms)
        self.lines = lines_through(field, spread, until, low, high)
        self.ends = disturbed_ends(field, self.lines, held) if len(self.lines.length) else b""

    def _sampled(self, count: int) -> Sampling:
        length = float(self.lines.length.max(initial=0.0))
        steepness = np.abs(self.lines.direction).max(axis=0, initial=0.0)
        x, y, z = (float(size) for size in np.minimum(steepness, 1.0))
        # Where the stop is met head on, a deflection still counts in second order.
        lever_arm = math.sqrt(0.5 * self.held * length)
        is_fine = self.held < FINE_SHARE * greatest_path(self.field)
        return Sampling(SPACING_MARGIN * length / count, (x, y, z), lever_arm, is_fine, self.ends)

    def least_count(self, count: int, is_worth_it, cost_again) -> int:
        """The number of samples, at least `count`, with the least cost, rays that are traced again included.

        Args:
            count: The least number.
            is_worth_it: Whether a number of samples costs less than error control.
            cost_again: Predicts the cost of a ray that is traced again, in samples.
        """
        best, best_cost = 0, math.inf
        before = 0, math.inf
        while is_worth_it(count) and count < best_cost:
            found = self._greatest(count)
            if found <= NEGLIGIBLE * self.held:
                count = self._between_counts(before, (count, found))
                return count if count < best_cost else best
            sampled = self._sampled(count)
            rejected = float((missed_along(self.field, sampled, self.lines) > REJECTED * self.held).mean())
            cost = count + (rejected * cost_again() if rejected > 0.0 else 0.0)
            if cost < best_cost:
                best, best_cost = count, cost
            before = count, found
            count = _in_threes(FINER * count)
        return best

    def _between_counts(self, few: tuple[int, float], many: tuple[int, float]) -> int:
        """The number of samples between one too small and one great enough, by a power law through what both miss."""
        if few[0] and many[1] > 0.0:
            order = math.log(few[1] / many[1]) / math.log(many[0] / few[0])
            count = _in_threes(few[0] * (few[1] / (NEGLIGIBLE * self.held)) ** (1.0 / order))
            if count < many[0] and self._greatest(count) <= NEGLIGIBLE * self.held:
                return count
        return many[0]

    def _greatest(self, count: int) -> float:
        """The most that any ray misses between this many samples [m]."""
        return greatest_error(self.field, self._sampled(count), self.lines) if len(self.lines.length) else 0.0

    def sufficient(self, count: int) -> int:
        """This number of samples, or a few more, between which nothing lies; 0 where there is something.

        By the rule's own bound if a few more are enough for that: what it leaves of the rest takes longer to find than
        they do.
        """
        if not len(self.lines.length):
            return count
        allowed = NEGLIGIBLE * self.held
        by_rule = self._by_rule(count)
        if by_rule <= allowed:
            return count
        more = _in_threes(count * (1.02 * by_rule / allowed) ** 0.25)
        if more <= A_FEW_MORE * count and self._by_rule(more) <= allowed:
            return more
        return count if self._greatest(count) <= allowed else 0

    def _by_rule(self, count: int) -> float:
        """The same by the rule's own bound, which is greater and sooner found."""
        return greatest_error(self.field, self._sampled(count), self.lines, by_rule=True)

    def sampling(self, count: int) -> Sampling | None:
        """How this many samples lie along the rays; None where nothing lies between them."""
        return None if self._greatest(count) <= NEGLIGIBLE * self.held else self._sampled(count)


class _Level:
    """The pilot, traced with `count` samples a ray."""

    def __init__(
        self, field: IndexField, pilot: RayBundle, plan: TracePlan, until, wavelength: float, count: int, share=1.0
    ):
        trial = replace(plan, sample_count=count, quadrature_error_scale=share)
        arrays = on_host(launch(field, pilot, trial, until, wavelength, frozenset(("opd", "step_error"))))
        self.count = count
        self.opd = arrays["opd"]
        self.good = reached(arrays["status"]) & np.isfinite(arrays["step_error"])
        lost = reached(arrays["status"]) & ~self.good
        self.is_fit = bool(self.good.any() and lost.mean() <= UNFIT)
        self.difference = float(arrays["step_error"][self.good].max()) if self.good.any() else 0.0

    def error(self, finer: "_Level") -> float:
        """Greatest change of the optical path difference from this level to a finer one [m]."""
        good = self.good & finer.good
        return float(np.abs(self.opd - finer.opd)[good].max()) if good.any() else math.inf


def _least_samples(field: IndexField, pilot: RayBundle, tolerance: float, lever_arms: LeverArms | None) -> int:
    """The number of samples that are WIDEST cells apart on the longest path through the field's support."""
    grid = field.samples
    low, high = support_box(field, tolerance, lever_arms)
    size = np.zeros(3)
    size[-len(low) :] = high - low
    if field.geometry == "axisymmetric":
        size[:2] = 2.0 * high[0]
    spacing = np.full(3, np.inf)
    spacing[-len(grid.spacing) :] = grid.spacing
    if field.geometry == "axisymmetric":
        spacing[:2] = grid.spacing[0]
    steep = np.maximum(np.abs(pilot.direction), 1e-12)
    length = np.where(size > 0.0, size / steep, np.inf).min(axis=1)
    length[~np.isfinite(length)] = 0.0  # nothing is disturbed
    cells = length * np.linalg.norm(pilot.direction / spacing, axis=1)
    return _in_threes(max(LEAST_SAMPLES, float(cells.max(initial=0.0)) / WIDEST))


def _is_worth_it(field: IndexField, pilot: RayBundle, plan: TracePlan, wavelength: float, count: int) -> bool:
    """Whether this many samples cost less than error control; that cost is predicted only where it may decide."""
    if count <= CHEAP[plan.backend] or count > MOST_SAMPLES:
        return count <= MOST_SAMPLES
    predicted = predict_evaluations(field, held_error(field, plan.tolerance * wavelength), pilot.direction)
    return count <= WORTH[plan.backend] * predicted


def _in_threes(count: float) -> int:
    return 3 * math.ceil(count / 3.0 - 1e-9)
