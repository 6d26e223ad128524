"""What differs, by cause, where one thing about a run is done another way, for some of its rays: docs/theory/budget.md.

Changes of a uniform grid are integrated along the traced paths, to first order; "step", "precision", "bundle" and, to a
stop, "resampling" are of a few rays that are traced again.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from ...display.quantities import CAUSES, ErrorBudget, combine
from ...medium import IndexField
from ...medium.grid import UniformGrid
from ...medium.refined import refined
from ...rays import RayBundle
from ..launch import run_plan
from ..plan import TracePlan
from ..step_bound import step_allowance
from ..stop import reached
from .jumps import jumps, lacking, next_order, patterns
from .orders import change_in_planes, change_on_two_axes, thinned_along_r, thinned_sums
from .paths import Cause, Paths, Rays, paths_of, shortest_cell

# Rays whose changes are integrated, of a volume and of a field of two axes; how many of them are traced again.
SAMPLE, SAMPLE_OF_TWO_AXES, TRACED = 512, 256, 128
# Parts of the rays of which each is a sample of the whole bundle.
BLOCKS = 8
# Rays among which some are chosen, and cells along a side of the curve through them.
CANDIDATES, CURVE = 1 << 14, 1 << 10
# The order of a grid's interpolant, and the next.
ORDERS = {"cubic": (3, 5), "linear": (1, 3), "monotone": (1, 3)}
# Tolerance of the rays that measure the steps', as a share, and the greatest tolerance that it is a share of [waves].
TIGHTER, LARGEST_TOLERANCE = 0.1, 1e-3
# (field, another in its place) -> what that changes
Change = Callable[[IndexField, IndexField], Rays]


@dataclass(frozen=True, eq=False)
class Variants:
    """Some rays of a run, their starts [m], shares in means, what they bring to the stop, and changes by cause."""

    start: np.ndarray
    ahead: np.ndarray
    weight: np.ndarray
    base: Rays
    causes: Mapping[str, Cause]


def sample_size(field: Any) -> int:
    """Return the number of rays whose changes are computed, of a field or a mesh of this geometry."""
    return SAMPLE if field.geometry == "volume" else SAMPLE_OF_TWO_AXES


def sample_rows(field: Any, rays: RayBundle, good: np.ndarray) -> np.ndarray:
    """Rows of some of the rays that arrived; every eighth in this order is spread over the whole bundle.

    They are evenly spread along a curve through the places at which the rays are some way from their starts.
    """
    rows = np.flatnonzero(good)
    if len(rows) > CANDIDATES:
        rows = np.sort(np.random.default_rng(0).choice(rows, CANDIDATES, replace=False))
    if not len(rows):
        return rows
    places = _spread_out(rays.rows(rows))
    across = places - places.mean(axis=0)
    place = across @ np.linalg.svd(across, full_matrices=False)[2][:2].T
    extent = np.maximum(np.ptp(place, axis=0), 1e-300)
    cell = np.minimum((place - place.min(axis=0)) / extent * CURVE, CURVE - 1).astype(np.int64)
    bits = np.arange(int(np.log2(CURVE)))
    key = np.sum(((cell[:, :, None] >> bits) & 1) << (2 * bits + np.arange(2)[:, None]), axis=(1, 2))
    count = min(sample_size(field), len(rows))
    # One at random of each part of the curve, and at random to the blocks: the rays may be a grid.
    rng = np.random.default_rng(0)
    part = np.floor((np.arange(count) + rng.random(count)) * (len(rows) / count)).astype(int)
    block = np.concatenate([rng.permutation(BLOCKS) for _ in range(-(-count // BLOCKS))])[:count]
    return rows[np.argsort(key, kind="stable")][part][np.argsort(block, kind="stable")]


def few_rows(count: int, few: int = TRACED) -> np.ndarray:
    """The places of the few among so many rays that are traced again, at random, since Sobol points alternate."""
    return np.sort(np.random.default_rng(1).permutation(count)[:few])


def _spread_out(rays: RayBundle) -> np.ndarray:
    """Return points ahead of the rays by the size of the bundle [m], (n, 3): different for different rays."""
    start = rays.position
    return np.asarray(start + rays.direction * np.linalg.norm(start - start.mean(axis=0), axis=1).max(initial=1e-3))


def variants(
    field: IndexField,
    rays: RayBundle,
    base: Rays,
    plan: TracePlan,
    until,
    wavelength: float,
    *,
    weight: np.ndarray | None = None,
    lost: np.ndarray | None = None,
    group: int = 1,
) -> Variants:
    """Return how some rays of a run, all of which arrived, change by each cause.

    `base` is what they brought to their stop, `weight` their shares in means over the bundle (None: equal ones), and
    `lost` the optical path that the source has beyond the field's cuts [m]. Of `group` consecutive rays that belong
    together, as those of a pixel, whole groups are traced again.
    """
    paths = paths_of(field, rays.position, rays.direction, until, (base.position, base.direction))
    lost = np.zeros(rays.ray_count) if lost is None else lost
    traced = _Traced(field, rays, base, plan, until, wavelength, group)
    causes = traced.steps()

    def to_source(one: IndexField, source: IndexField) -> Rays:
        if until is None:  # the rays end on faces that the source does not have
            return along(paths)(one, source)
        change = traced.change(one, source)
        return replace(change, opd=change.opd - lost)

    way = base.position - rays.position  # of which the part across the undisturbed rays counts
    moved = way - np.sum(way * rays.direction, axis=1, keepdims=True) * rays.direction
    bent = Rays(base.opd, base.direction - rays.direction, moved)
    causes |= _of_field(field, paths, traced.change, to_source, bent, lost)
    weight = np.full(rays.ray_count, 1.0 / rays.ray_count) if weight is None else weight
    return Variants(
        rays.position, rays.direction, weight, base, {name: causes[name] for name in CAUSES if name in causes}
    )


def line_variants(field: IndexField, paths: Paths, lost: np.ndarray) -> Variants:
    """Return how integrals along given paths change by each cause; `lost` is what cuts leave out of each [m], (n,)."""
    base, change = paths.integral(field.evaluate, shortest_cell(field, paths)), along(paths)
    count = len(paths.length)
    causes = _of_field(field, paths, change, change, base, lost)
    return Variants(paths.first, paths.ahead, np.full(count, 1.0 / count), base, causes)


def along(paths: Paths) -> Change:
    """Return what integrates changes of the field along paths."""

    def change(field: IndexField, other: IndexField) -> Rays:
        def difference(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            (value, slope), (before, slope_before) = other.evaluate(points), field.evaluate(points)
            return value - before, slope - slope_before

        return paths.integral(difference, min(shortest_cell(field, paths), shortest_cell(other, paths)))

    return change


def _of_field(
    field: IndexField, paths: Paths, change: Change, to_source: Change, bent: Rays, lost: np.ndarray
) -> dict[str, Cause]:
    """Return the changes by the samples, the source and the model; `bent` is what the contrast makes of rays."""
    if field.resampling is None:
        causes = _by_index(field, paths, change)
    elif field.source is None:
        causes = {"resampling": Cause(known=(bent * np.nan,))}
    else:
        by_source = to_source(field, field.source)
        causes = _by_index(field.source, paths, change)
        causes["resampling"] = Cause(known=(by_source,))
    if np.any(lost):
        causes["truncation"] = Cause(known=(replace(Rays.still(len(lost)), opd=lost),))
    made = field.upstream
    if made is not None:
        causes["refractivity"] = Cause(known=(bent * made.refractivity,))
        if made.columns > 0.0:
            size, before = np.full(len(lost), made.columns), causes.get("resampling", Cause())
            causes["resampling"] = replace(before, draws=patterns(field, paths, size, float(np.max(field.spacing))))
    return causes


def _by_index(field: IndexField, paths: Paths, change: Change) -> dict[str, Cause]:
    """Return the changes by the order of interpolation and by jumps of a field that was not resampled."""
    if isinstance(field.samples, UniformGrid):
        orders = ORDERS[field.interpolation]
        order = (change_in_planes if field.geometry == "volume" else change_on_two_axes)(field, paths, orders)
        sums = (thinned_sums(field, paths, orders[0]), thinned_along_r(field, paths, orders[0]))
        return {"interpolation": Cause(like=(order,)), "jumps": jumps(field, paths, sums)}
    finer = field.derive("refined", lambda: refined(field)) if field.interpolation == "bilinear" else None
    if finer is None:
        order = paths.integral(next_order(field), shortest_cell(field, paths))
    else:
        # A mesh's next order over its change by cells cut in four.
        order = change(field, finer) * (4.0 / 3.0)
    return {"interpolation": Cause(like=(order,)), "jumps": Cause(like=(lacking(field, paths),))}


def brought(field: IndexField, rays: RayBundle, plan: TracePlan, until, wavelength: float) -> tuple[Rays, np.ndarray]:
    """Trace rays by a plan; return what they bring to their stop, and their status."""
    arrays = run_plan(field, rays, plan, until, wavelength, frozenset(("opd", "position", "direction", "step_error")))
    opd, direction, position = (np.asarray(arrays[name]) for name in ("opd", "direction", "position"))
    return Rays(opd, direction, position), np.asarray(arrays["status"])


class _Traced:
    """Traces few of some rays again, by other plans and through other fields; each stands for those nearest to it."""

    def __init__(
        self, field: IndexField, rays: RayBundle, base: Rays, plan: TracePlan, until, wavelength: float, group: int
    ):
        """Take the rays, all of which arrived, in groups of a size, and what they brought by a plan."""
        self.field, self.base, self.plan, self.stop = field, base, plan, (until, wavelength)
        self.rays, self.group = rays, group
        # What a coarse grid makes of a mesh's shocks is finer than the distance of few rays.
        few = rays.ray_count if field.resampling is not None else TRACED
        self.groups = few_rows(rays.ray_count // group, max(few // group, 1))
        self.few = (self.groups[:, None] * group + np.arange(group)).ravel()
        self.some = rays.rows(self.few)

    def tight(self, field: IndexField) -> TracePlan:
        """Return the plan of rays through a field whose steps and precision leave no error that counts."""
        return replace(
            self.plan,
            method="adaptive",
            sample_count=0,
            cubes=False,
            step=None,
            backend="warp" if self.plan.backend == "reference" else self.plan.backend,
            precision="float64",
            tolerance=TIGHTER * min(self.plan.tolerance, LARGEST_TOLERANCE),
            max_steps=max(self.plan.max_steps, step_allowance(field, "adaptive", None, None)),
        )

    @cached_property
    def true(self) -> dict[int, tuple[Rays, np.ndarray]]:
        """The rays through fields by such plans, by the fields' identities."""
        return {}

    def through(self, field: IndexField) -> tuple[Rays, np.ndarray]:
        """Trace the rays through a field by such a plan."""
        if id(field) not in self.true:
            self.true[id(field)] = brought(field, self.some, self.tight(field), *self.stop)
        return self.true[id(field)]

    def change(self, field: IndexField, other: IndexField) -> Rays:
        """Return what another field in the place of one changes, for all rays."""
        return self._for_all({"": self.through(field), "other": self.through(other)})["other"]

    def steps(self) -> dict[str, Cause]:
        """Return the changes by bundle, precision and steps."""
        plan, few = self.plan, (self.base[self.few], np.zeros(len(self.few), int))
        one_by_one = brought(self.field, self.some, plan, *self.stop) if plan.bundle is not None else few
        doubled = replace(plan, precision="float64")
        double = brought(self.field, self.some, doubled, *self.stop) if plan.precision != "float64" else one_by_one
        chain = {"": few, "bundle": one_by_one, "precision": double, "step": self.through(self.field)}
        return {name: Cause(known=(change,)) for name, change in self._for_all(chain).items()}

    def _for_all(self, chain: dict[str, tuple[Rays, np.ndarray]]) -> dict[str, Rays]:
        """Return the changes from one to the next, for all rays those of the nearest few; NaN where none arrived."""
        from scipy.spatial import cKDTree

        names, group = list(chain), self.group
        good = np.logical_and.reduce([reached(status) for _, status in chain.values()]).reshape(-1, group).all(axis=1)
        if not good.any():
            return dict.fromkeys(names[1:], self.base * np.nan)
        places = _spread_out(self.rays).reshape(-1, group, 3).mean(axis=1)
        there = np.flatnonzero(good)
        _, nearest = cKDTree(places[self.groups[there]]).query(places)
        rows = (there[nearest][:, None] * group + np.arange(group)).ravel()
        return {name: (chain[name][0] - chain[before][0])[rows] for before, name in pairwise(names)}


FACTOR = 2.0
# What rays bring -> a number, or an array of them.
Number = Callable[[Rays], Any]


def spread(number: Number, base: Rays, cause: Cause, plain: np.ndarray) -> np.ndarray:
    """Return the error of a number, or of each in an array, by one cause; `plain` is the number of the base."""
    count = len(base.opd)
    block = np.arange(count) * BLOCKS // max(count, 1)
    total = np.zeros(plain.shape)
    for change in (*cause.known, *cause.like):
        if not (np.any(change.opd) or np.any(change.direction) or np.any(change.position)):
            continue
        total += np.square(number(base + change) - plain)
        centred = change.lifted(-change.opd.mean())
        samples = np.array([BLOCKS * (number(base + centred * (block == k)) - plain) for k in range(BLOCKS)])
        total += samples.var(axis=0) / (BLOCKS - 1 if change in cause.known else 1)
    for draw in cause.draws:
        total += np.square(number(base + draw) - plain) / len(cause.draws)
    return np.asarray(FACTOR * np.sqrt(total))


def of_each(pick: Number, found: Variants, near: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """Return the error by cause of what each ray has of its own.

    `pick` returns it for changes of the rays, shape (n, ...), 0 for none; n pixels may have several rays each. `near`
    are the rays or pixels about each, by which its error is found, shape (m, k); None for one error of all.
    """
    everywhere = np.arange(len(found.base.opd))[None] if near is None else near

    def square(change: Rays) -> np.ndarray:
        return np.asarray(np.square(pick(change))[everywhere].mean(axis=1))

    errors = {}
    for name, cause in found.causes.items():
        total = square(Rays.still(len(found.base.opd))) + sum(map(square, (*cause.known, *cause.like)))
        total = total + sum(map(square, cause.draws)) / max(len(cause.draws), 1)
        errors[name] = FACTOR * np.sqrt(total)
    return errors


def of_a_ray(pick: Number, found: Variants, unit: str = "", others: Mapping[str, Number] | None = None) -> ErrorBudget:
    """Return the error budget of what each ray has of its own, the same for all; `others` replace `pick` by cause."""
    picks = {name: (others or {}).get(name, pick) for name in found.causes}
    errors = {
        name: of_each(one, replace(found, causes={name: found.causes[name]}))[name] for name, one in picks.items()
    }
    return combine({name: float(error[0]) for name, error in errors.items()}, unit)


def errors(number: Number, found: Variants) -> dict[str, np.ndarray]:
    """Return the error of a number, or of each in an array, by cause."""
    plain = np.asarray(number(found.base))
    return {name: spread(number, found.base, cause, plain) for name, cause in found.causes.items()}


def budget(number: Number, found: Variants, unit: str = "", **others: float) -> ErrorBudget:
    """Return the error budget of one number; `others` are errors by causes that no ray shows, such as "sampling"."""
    return combine({name: float(error) for name, error in errors(number, found).items()} | others, unit)
