"""Choose the number of leapfrog samples of a bundle of nearly straight rays (engines/warp/kernels/leapfrog.py).

A pilot of some rays is traced with N, 3 N and perhaps 9 N samples: the differences give the order of convergence and
the least N that meets the tolerance. Each ray's own estimate is scaled to cover the pilot's errors with a margin; rays
above the tolerance nevertheless are traced again (launch.py).
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from aerokernels.tracing.tasks.cube_polynomials import approximate_deviation, may_have_cubes
from aerokernels.tracing.tasks.unresolved import Sampling, grid_of

from ...derived import cached_on
from ...device_arrays import extremes_of, is_one_row
from ...medium import IndexField
from ...medium.grid import UniformGrid
from ...rays import RayBundle
from ..engines import engine_of
from ..error_limit import error_limit, support_box
from ..launch import Trials
from ..lines import lever_arms_of, outermost, outermost_rays
from ..plan import TracePlan
from ..stop import ArcLength
from .between_samples import MARGIN, SPREAD_RAYS, MissedStructure, multiple_of_three
from .pilot import LEAST_RAYS, SampleCost, error_scales, greatest_bend, level_pair, levels_of

# Greatest distance of samples in cells. Structure between the samples is bounded from the field as well.
WIDEST = 7.0
LEAST_SAMPLES = 36

# Polynomials of cubes are made where rays take this many samples for each node of the grid, on a CPU (False) and on a
# GPU (True), where a sample costs less. They are used where retracing rays because of them costs less than the share
# CUBES_GAIN of the samples, which is their least saving.
CUBES_WORTH = {False: 4.0, True: 16.0}
CUBES_GAIN = 0.5
CUBES_MORE = 1.4
# Numbers of samples that are tried with polynomials: the sum of a ray's error bounds may be just above the tolerance.
CUBES_TRIALS = 3

# What is compared between traces of the pilot.
PILOT_OUTPUTS = frozenset(("opd", "step_error", "direction"))

# Searches of each kind that a field caches, and parts of fields in which a bundle caches its extent.
CACHED, PARTS = 8, 2  # speed only


def may_be_leapfrog(field: IndexField, ray_count: int, until) -> bool:
    """Whether so many rays may be traced by leapfrog: on a cubic uniform grid, out of the box or to a plane."""
    if not (isinstance(field.samples, UniformGrid) and field.interpolation == "cubic"):
        return False
    return ray_count >= LEAST_RAYS and not isinstance(until, ArcLength)


@cached_on("rays", PARTS)
def _some_of(rays: RayBundle, geometry: str, until, low: np.ndarray, high: np.ndarray) -> RayBundle:
    """Some of many rays, those outermost in position, in direction and within a part of the field [m] among them."""
    rows = [np.linspace(0, rays.ray_count - 1, SPREAD_RAYS).round().astype(int)]
    if rays.device not in (None, "cpu"):
        rows += [extremes_of(rays.held(name)).rows for name in ("position", "direction")]
    elif geometry != "axisymmetric" and is_one_row(rays.direction) and (np.ptp(rays.position, axis=0) == 0.0).any():
        # Parallel rays from a plane across an axis are as far apart everywhere as there.
        rows.append(outermost(rays.position))
    else:
        rows.append(outermost_rays(geometry, rays.position, rays.direction, until, low, high))
    return rays.rows(np.concatenate(rows))


@dataclass(frozen=True)
class _Fit:
    """A number of leapfrog samples that meets the tolerance (see TracePlan), and the pilot's greatest error [m]."""

    count: int
    scales: tuple[float, float]
    worst: float
    sampling: Sampling | None
    searched: int
    steepest: tuple[float, float, float]


def fit_leapfrog(
    field: IndexField,
    pilot: RayBundle,
    plan: TracePlan,
    until,
    wavelength: float,
    rays: RayBundle | None = None,
    like: TracePlan | None = None,
    ray_count: int = 0,
) -> TracePlan | None:
    """Return the plan with the number of leapfrog samples that meets its tolerance; None if error control is cheaper.

    `rays` are None if the pilot shows their extent. The number of the plan `like` is taken where the pilot confirms it.
    `ray_count` is the least number of rays that will take these samples.
    """
    plan = replace(plan, lever_arms=lever_arms_of(field, pilot, until))
    part = support_box(field, error_limit(field, plan.tolerance * wavelength), plan.lever_arms)
    some = pilot if rays is None else rays
    if rays is not None and some.ray_count > SPREAD_RAYS:
        some = _some_of(rays, field.geometry, until, *part)
    given = field, pilot, plan, until, wavelength, some
    # Not the number confirmed last, which may be a few samples more: each confirmation would add a few again.
    fit = _found(*given, "confirm", like.searched_count) if like is not None and like.searched_count else None
    fit = fit or _found(*given, "search")
    if fit is None:
        return None
    cubes = _found(*given, "with_cubes", fit) if _may_take_cubes(field, plan, ray_count * fit.count) else None
    fit = cubes or fit
    reason = (
        f"method leapfrog: {fit.count} leapfrog samples a ray, bending included; a pilot of {pilot.ray_count} rays has "
        f"an error of {fit.worst / wavelength:.1g} waves; rays whose own error estimate is above the tolerance are "
        "traced again"
    )
    if cubes is not None:
        reason += "; each evaluates a cubic polynomial of 2 x 2 x 2 cells, which is accurate enough for the tolerance"
    if fit.sampling is not None:
        reason += "; the field has structure between samples, whose effect on each ray is bounded along its path"
    return replace(
        plan,
        sample_count=fit.count,
        searched_count=fit.searched,
        cubes=cubes is not None,
        quadrature_error_scale=fit.scales[0],
        trajectory_error_scale=fit.scales[1],
        sampling=fit.sampling,
        steepest=fit.steepest,
        reasons=(reason, *plan.reasons),
        predicted_evaluations=float(fit.count),
        predicted_error=fit.worst / wavelength,
    )


@cached_on("field", 3 * CACHED)
def _found(
    field: IndexField, pilot: RayBundle, plan: TracePlan, until, wavelength: float, some: RayBundle, search: str, *start
) -> _Fit | None:
    """The result of a search of `_Fitting`, by the name of its method."""
    fit: _Fit | None = getattr(_Fitting(field, pilot, plan, until, wavelength, some), search)(*start)
    return fit


def _may_take_cubes(field: IndexField, plan: TracePlan, samples: int) -> bool:
    """Whether polynomials of cubes can be made for a field, and pay for so many samples."""
    grid, engine = field.samples, engine_of(plan.backend, plan.device)
    if plan.precision != "float32" or not isinstance(grid, UniformGrid):
        return False
    # The greatest share of the device's largest allocation that they may take.
    if not may_have_cubes(grid, 0.25 * engine.memory[1]):
        return False
    return samples >= CUBES_WORTH[engine.is_gpu] * grid.samples.size


@dataclass(frozen=True, eq=False)
class _Fitting:
    """The search for the number of leapfrog samples of a bundle; `some` of the rays show its extent."""

    field: IndexField
    pilot: RayBundle
    plan: TracePlan
    until: Any
    wavelength: float
    some: RayBundle

    @cached_property
    def limit(self) -> float:
        """The OPD error allowed to a ray [m]."""
        return error_limit(self.field, self.plan.tolerance * self.wavelength)

    def search(self) -> _Fit | None:
        """The least number of samples that meets the tolerance; None where none does, or error control is cheaper."""
        budget = self.limit / MARGIN
        least = self._least_samples()
        if not self.cost.is_worth_it(least):
            return None
        trials = self._trials(replace(self.plan, sample_count=least))
        level, finest = levels_of(trials, least, 3 * least)
        if not finest.is_fit:
            return None
        levels, first, count = [level, finest], level.error(finest), least
        if first > budget:
            levels += levels_of(trials, 9 * least)
            if not levels[-1].is_fit:
                return None
            second = finest.error(levels[-1])
            order = 1.0
            if second > 0.0:
                order = min(max(math.log(first / second) / math.log(3.0), 1.0), 4.0) if first > second else 1.0
            count = multiple_of_three(least * (first / budget) ** (1.0 / order))
        count = self.structure.least_count(count, self.cost.is_worth_it, self.cost.of_retraced)
        while count and self.cost.is_worth_it(count):
            (level,) = [level for level in levels if level.count == count] or levels_of(trials, count)
            finest = levels[-1]
            if 2 * count > finest.count:
                (finest,) = levels_of(trials, 3 * count)
                levels.append(finest)
            worst = level.error(finest)
            if level.is_fit and worst <= budget:
                scales = error_scales(level, worst, greatest_bend(trials, count))
                return _Fit(count, scales, worst, self.structure.sampling(count), count, self.structure.steepness)
            count = multiple_of_three(1.25 * count)
        return None

    def confirm(self, searched: int) -> _Fit | None:
        """This number of samples, or a few more; None if they are inaccurate or may miss structure."""
        if searched < self._least_samples():
            return None
        count = self.structure.sufficient(searched)
        if not count:
            return None
        trials = self._trials(replace(self.plan, sample_count=count))
        level, finest, bends = level_pair(trials, count)
        worst = level.error(finest)
        if not (level.is_fit and finest.is_fit and worst <= self.limit / MARGIN):
            return None
        return _Fit(count, error_scales(level, worst, bends), worst, None, searched, self.structure.steepness)

    def with_cubes(self, fit: _Fit) -> _Fit | None:
        """At least as many samples of polynomials of cubes; None where the tolerance needs the spline."""
        structure, count = self.structure, fit.count
        some = structure.lines.every(max(1, len(structure.lines.length) // 64))  # about 64 tell whether it is worth it
        deviation = approximate_deviation(grid_of(self.field), some)
        rough = np.count_nonzero(deviation > self.limit) / max(1, len(some.length))
        if not self._may_retrace(rough, count):
            return None  # decided before a table is made
        # A sample costs so little that taking some more is cheaper than looking up the bound on structure between them.
        count = structure.fewest(count, multiple_of_three(CUBES_MORE * count)) or count
        for taken in range(count, count + 3 * CUBES_TRIALS, 3):
            sampling = structure.sampling(taken)
            plan = replace(self.plan, sample_count=taken)
            by_cubes = replace(plan, cubes=True)
            spline, finest, bends = level_pair(self._trials(plan), taken)
            (level,) = levels_of(self._trials(by_cubes), taken)
            worst = level.error(finest)
            fits = level.is_fit and finest.is_fit and worst <= self.limit / MARGIN
            # The greatest change of a pilot ray's direction caused by them [rad].
            if not (fits and level.turn(spline) <= 5e-7):
                return None
            scales = error_scales(spline, worst, bends)
            final = self._trials(replace(by_cubes, sampling=sampling))
            again = float((final((taken, *scales))[0]["step_error"] > self.limit).mean())
            if self._may_retrace(again, taken):
                return _Fit(taken, scales, worst, sampling, fit.searched, fit.steepest)
        return None

    def _may_retrace(self, share: float, count: int) -> bool:
        """Whether tracing this share of the rays again costs less than cubes save of so many samples."""
        return share == 0.0 or share * self.cost.of_retraced() <= CUBES_GAIN * count

    def _trials(self, plan: TracePlan) -> Trials:
        return Trials(self.field, self.pilot, plan, self.until, self.wavelength, PILOT_OUTPUTS)

    @cached_property
    def structure(self) -> MissedStructure:
        """The structure that the rays may miss between samples."""
        # On a GPU error control of a few rays takes longer than fewer samples of all save: docs/decisions.md.
        leaves_steepest = not engine_of(self.plan.backend, self.plan.device).is_gpu
        arms = self.plan.lever_arms
        return MissedStructure(self.field, self.some, self.until, self.limit, arms, self.pilot, leaves_steepest)

    @cached_property
    def cost(self) -> SampleCost:
        """What samples cost beside error control."""
        return SampleCost(self.field, self.pilot, self.plan, self.limit, self.structure.length)

    def _least_samples(self) -> int:
        """Samples that are WIDEST cells apart on the longest path of the rays through the field's support."""
        low, high = support_box(self.field, self.limit, self.plan.lever_arms)
        return multiple_of_three(max(LEAST_SAMPLES, _greatest_cells(self.field, self.pilot, low, high) / WIDEST))


def _greatest_cells(field: IndexField, pilot: RayBundle, low: np.ndarray, high: np.ndarray) -> float:
    """Cells on the longest path through a part of the field, given by its corners along the local axes [m]."""
    grid, size = field.samples, np.zeros(3)
    size[-len(low) :] = high - low
    if field.geometry == "axisymmetric":
        size[:2] = 2.0 * high[0]
    spacing = np.full(3, np.inf)
    spacing[-len(grid.spacing) :] = grid.spacing
    if field.geometry == "axisymmetric":
        spacing[:2] = grid.spacing[0]
    steep = np.maximum(np.abs(pilot.direction), 1e-12)
    length = np.where(size > 0.0, size / steep, np.inf).min(axis=1)
    length[~np.isfinite(length)] = 0.0  # the support is empty
    cells = length * np.linalg.norm(pilot.direction / spacing, axis=1)
    return float(cells.max(initial=0.0))
