"""The bound of structure between samples, put together from its parts, and counts of leapfrog samples."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.ndimage import maximum_filter

from aerokernels import IndexField, Plane, RayBundle
from aerokernels.tracing.blocks import block_maxima, greatest_around
from aerokernels.tracing.error_limit import error_limit
from aerokernels.tracing.leapfrog import missed_on_lines, unresolved
from aerokernels.tracing.leapfrog import sample_count as leapfrog
from aerokernels.tracing.leapfrog.between_samples import NEGLIGIBLE, MissedStructure, multiple_of_three
from aerokernels.tracing.leapfrog.high_pass import high_pass
from aerokernels.tracing.leapfrog.missed_on_lines import path_of
from aerokernels.tracing.leapfrog.unresolved import Sampling
from aerokernels.tracing.plan import TracePlan
from aerokernels.tracing.step_bound import predict_evaluations
from aerokernels.tracing.straight_lines import Lines
from tests.random_air import random_air

GEOMETRIES = ("volume", "planar", "axisymmetric")


def field_of(geometry: str, counts=(10, 13, 22), scale: float = 1e-2) -> IndexField:
    """Random air on cells of 0.5, 0.7 and 0.9 m."""
    return random_air(
        geometry, 211, lambda random, shape: scale * random.normal(size=shape), counts, (-2.0, -1.0, 0.0),
        (0.5, 0.7, 0.9), ambient_index=1.2,
    )  # fmt: skip


def lines_in(lever: bool, count: int = 9) -> Lines:
    """Lines upward from near the lower face of the box, not all as long."""
    rng = np.random.default_rng(212)
    start = np.c_[rng.uniform(-0.5, 0.5, (count, 2)), rng.uniform(0.1, 0.5, count)]
    way = np.c_[rng.uniform(-0.1, 0.1, (count, 2)), np.ones(count)]
    way /= np.linalg.norm(way, axis=1)[:, None]
    tangent = rng.uniform(0.1, 0.4, count) * lever
    length = rng.uniform(10.0, 14.0, count)
    return Lines(start, way, length, tangent * (length + 3.0), tangent)


@pytest.mark.parametrize("ends", [False, True])
@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_the_bound_of_blocks(geometry: str, ends: bool):
    """The lesser of the rule's bound and twice the means of what is not resolved, with the splines' lobes.

    At ends of rays three samples by seven times the rule's bound, or half a sample of what is passed there, whichever
    is less; of the blocks in which no ray ends the whole potential stands for half of what is passed.
    Samples so dense that they resolve all but a spline's images count for the fourth power of their distance.
    """
    field = field_of(geometry)
    grid, steep = field.samples, (0.1, 0.2, 1.0)
    share_of = {
        "volume": np.array(steep),
        "planar": np.array(steep[1:]),
        "axisymmetric": np.array([np.hypot(0.1, 0.2), 1.0]),
    }
    obliquity = share_of[geometry]
    for spacing in (0.3, 1.1):
        sampling = Sampling(spacing, steep, 0.4)
        if ends:
            shape = tuple(-(-(n - 1) // 4) for n in grid.shape)
            marked = np.random.default_rng(213).integers(0, 2, shape).astype(np.uint8)
            sampling = dataclasses.replace(sampling, ends=np.packbits(marked).tobytes())
        finest = 0.8 / (obliquity / grid.spacing).max()
        used, share = max(spacing, finest), min(spacing / finest, 1.0) ** 4
        edges = (0.92, 0.37) if ends else (0.92,)
        parts = [high_pass(grid, obliquity, used, edge, True) for edge in edges]
        means = unresolved._by_blocks(grid, geometry, sampling, np.abs(parts[0]).__getitem__)
        rule = unresolved._by_rule(grid, geometry, sampling)
        for axis in range(means.ndim - 1):  # beside the main axis, the last
            means = np.maximum(means, 0.15 * greatest_around(means, -1, 1, axis))
        factor = 1.0 + 2.0 * 0.4 / min(grid.spacing)
        block, found = unresolved.missed_in_blocks(field, sampling)
        np.testing.assert_allclose(found, factor * np.minimum(rule, 2.0 * share * means), rtol=1e-9)
        assert block == 4
        at_ends = unresolved.missed_at_ends(field, sampling)
        if not ends:
            assert at_ends is None
            continue
        whole = block_maxima(np.abs(grid.samples * (grid.ambient_index + grid.samples / 2) / grid.ambient_index), 4)
        size = np.where(marked, block_maxima(np.abs(parts[1]), 4), 2.0 * whole)
        least = np.minimum(21.0 * spacing * rule, 0.5 * share * used * size)
        np.testing.assert_allclose(at_ends, factor * maximum_filter(least, 3, mode="constant"), rtol=1e-9)
        if geometry == "volume":
            anywhere = dataclasses.replace(sampling, ends=unresolved.EVERYWHERE)
            least = np.minimum(21.0 * spacing * rule, 0.5 * share * used * block_maxima(np.abs(parts[1]), 4))
            at_ends = unresolved.missed_at_ends(field, anywhere)
            np.testing.assert_allclose(at_ends, factor * maximum_filter(least, 3, mode="constant"), rtol=1e-9)


@pytest.mark.parametrize("lever", [False, True])
@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_the_greatest_error_of_any_line(geometry: str, lever: bool):
    """The greatest block times the longest line, or layer by layer the greatest beside each, whichever is less.

    A lever arm adds the change from cell to cell, twice the error, times what is left of it in each layer.
    """
    field, lines = field_of(geometry), lines_in(lever)
    grid, sampling = field.samples, Sampling(1.1, (0.1, 0.1, 1.0), 0.4)
    block, missed = unresolved.missed_in_blocks(field, sampling)
    found = missed_on_lines.greatest_error(field, sampling, lines)
    path = path_of(lines, geometry, grid.low, block * grid.spacing, missed.shape)
    met = missed[path.part]
    change = 2.0 / min(field.spacing) * met * lever
    bounds = [(met.max() + change.max() * path.lever_arm) * path.longest]
    for layers in path.layers:
        amount = met + change * layers.lever_arms
        for axis, count in layers.beside:
            width = min(count, amount.shape[axis])
            moved = np.moveaxis(amount, axis, 0)
            runs = [moved[k : k + width].max(axis=0) for k in range(len(moved) - width + 1)]
            amount = np.moveaxis(np.array(runs), 0, axis)
        bounds.append(amount.sum(axis=layers.axis).max() * layers.thickness / layers.least)
    assert found == pytest.approx(min(bounds), rel=1e-9)
    assert path.longest == lines.length.max() and len(path.layers) >= 1
    by_rule = missed_on_lines.greatest_error(field, sampling, lines, by_rule=True)
    assert by_rule >= found
    refined = missed_on_lines.greatest_error(field, sampling, lines, allowed=0.0)
    assert refined <= found * (1.0 + 1e-12) and (lever or refined == found)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_changes_of_what_is_missed(geometry: str):
    """Twice the greatest slope of the unresolved part at nodes; along the main axis its part across rays.

    The slope in a cell is the difference of its nodes and a quarter of the second differences at both.
    """
    field, steep = field_of(geometry), (0.1, 0.2, 1.0)
    grid, sampling = field.samples, Sampling(1.1, steep, 0.4)
    obliquity = {"volume": (0.1, 0.2, 1.0), "planar": (0.2, 1.0), "axisymmetric": (np.hypot(0.1, 0.2), 1.0)}[geometry]
    part = high_pass(grid, np.array(obliquity), 1.1, 0.92, True)
    square = np.zeros(part.shape)
    for axis in range(part.ndim):
        across = np.linalg.norm(obliquity[:-1]) if axis == part.ndim - 1 else 1.0
        moved = np.moveaxis(part, axis, 0)
        step = np.abs(moved[1:] - moved[:-1])
        bend = np.zeros(moved.shape)
        bend[1:-1] = 0.25 * np.abs(moved[2:] - 2.0 * moved[1:-1] + moved[:-2])
        step = (step + bend[1:] + bend[:-1]) * across / grid.spacing[axis]
        both = np.zeros(moved.shape)
        both[1:], both[:-1] = step, np.maximum(both[:-1], step)
        both[1:] = np.maximum(both[1:], step)
        square += np.moveaxis(both, 0, axis) ** 2
    size = unresolved._by_blocks(grid, geometry, sampling, np.sqrt(square).__getitem__)
    for axis in range(size.ndim - 1):
        size = np.maximum(size, 0.15 * greatest_around(size, -1, 1, axis))
    found = unresolved._changes(grid, geometry, sampling)
    assert 1.1 > 0.8 / (np.array(obliquity) / grid.spacing).max()
    np.testing.assert_allclose(found, 2.0 * size, rtol=1e-9)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_ends_count_where_the_air_there_is_disturbed(geometry: str):
    """Of the blocks in which lines end those whose potential over a block's length is a fiftieth of the tolerance."""
    field, lines = field_of(geometry), lines_in(False)
    grid = field.samples
    potential = np.abs(grid.samples * (1.0 + grid.samples / 2.4))
    worth = block_maxima(potential, 4) * 4 * max(grid.spacing)
    near = missed_on_lines._blocks_of_ends(lines, geometry, grid.low, 4 * grid.spacing, worth.shape) > 0
    for limit in (np.median(worth[near]) / 0.02, 1e-9, 1e9):
        expected = near & (worth > 0.02 * limit)
        found = missed_on_lines.disturbed_ends(field, lines, limit)
        marked = unresolved.EVERYWHERE if geometry == "volume" else np.packbits(expected).tobytes()
        assert found == (marked if expected.any() else b"")


# --- counts ----------------------------------------------------------------------------------------------------------

H = 1e-4
STOP = Plane((0.0, 0.0, 30 * H), (0.0, 0.1, 1.0))


def smooth_field(scale: float = 3e-4) -> IndexField:
    y, z = np.meshgrid((np.arange(31) - 15) * H, np.arange(41) * H, indexing="ij")
    contrast = scale * np.exp(-((y / (9 * H)) ** 2) - ((z - 20 * H) / (9 * H)) ** 2)
    return IndexField.from_samples(contrast, origin=(-15 * H, 0.0), spacing=(H, H), geometry="planar")


def fitting(tolerance: float = 1e-2, backend: str = "warp", until=STOP) -> leapfrog._Fitting:
    rng = np.random.default_rng(214)
    pilot = RayBundle(np.c_[np.zeros(64), rng.uniform(-8 * H, 8 * H, 64), np.full(64, -H)], [0.0, 0.05, 1.0])
    plan = TracePlan("leapfrog", backend, "cpu", "float64", 1000, None, tolerance)
    return leapfrog._Fitting(smooth_field(), pilot, plan, until, 1e-6, pilot)


def test_counts_that_pay():
    """Up to 120 always, up to 3000 while they are at most 1.2 times error control's evaluations; on OpenCL 450, 5."""
    for backend, cheap, worth in (("warp", 120, 1.2), ("opencl", 450, 5.0)):
        fit = fitting(backend=backend)
        predicted = predict_evaluations(fit.field, fit.limit, fit.pilot.direction)
        assert fit.cost.evaluations == predicted and fit.cost.of_retraced() == max(cheap, worth * predicted)
        most = min(max(cheap, int(worth * predicted)), 3000)
        assert fit.cost.is_worth_it(cheap) and fit.cost.is_worth_it(most)
        assert not (fit.cost.is_worth_it(max(most, cheap) + 1) or fit.cost.is_worth_it(3001))
        assert fit.limit == error_limit(fit.field, 1e-8) and fit.grid is fit.field.samples


@pytest.mark.parametrize("beam, cost", [("parallel", 1), ("divergent", 1), ("converging", 1), ("scattered", 4)])
def test_samples_of_rays_that_part_share_no_lookups(beam: str, cost: int):
    """Directions that are no linear function of positions, by more than two cells at the end of the longest path."""
    rng = np.random.default_rng(216)
    place = np.c_[np.zeros(64), rng.uniform(-3.0, 3.0, 64), np.full(64, -3.0)]
    way = np.tile([0.0, 0.05, 1.0], (64, 1))
    way[:, 1] += {"divergent": 0.05, "converging": -0.05}.get(beam, 0.0) * place[:, 1]
    if beam == "scattered":
        way[:, 1] += rng.normal(0.0, 0.1, 64)
    pilot = RayBundle(place, way)
    for geometry, backend, expected in (("volume", "opencl", cost), ("volume", "warp", 1), ("planar", "opencl", 1)):
        plan = TracePlan("leapfrog", backend, "cpu", "float64", 1000, None, 1e-3)
        fit = leapfrog._Fitting(field_of(geometry), pilot, plan, None, 1e-6, pilot)
        assert fit.cost.of_sample == expected
        cheap, worth = {"opencl": (450, 5.0), "warp": (120, 1.2)}[backend]
        assert fit.cost.of_retraced() == max(cheap, worth * fit.cost.evaluations) / expected


def test_the_least_number_of_samples():
    """Seven cells apart on the longest path through the support, a multiple of three, and 36 at least."""
    fit = fitting()
    assert fit._least_samples() == 36
    low, high = leapfrog.support_box(fit.field, fit.limit, None)
    cells = leapfrog._greatest_cells(fit.field, fit.pilot, low, high)
    assert 7 * 36 > cells
    _, z = np.meshgrid((np.arange(9) - 4) * H, np.arange(401) * H, indexing="ij")
    long = IndexField.from_samples(1e-4 * np.cos(z / (30 * H)), origin=(-4 * H, 0.0), spacing=(H, H), geometry="planar")
    fit = dataclasses.replace(fit, field=long, pilot=RayBundle(np.zeros((4, 3)), [0.0, 0.0, 1.0]))
    assert fit._least_samples() == 3 * int(np.ceil(400 / 7.0 / 3.0))


@pytest.mark.parametrize("tolerance", [1e-1, 1e-3, 1e-5])
def test_the_number_found_meets_the_tolerance(tolerance: float):
    """The pilot by so many samples is within a quarter of the tolerance of the pilot by nine times as many."""
    fit = fitting(tolerance)
    found = fit.search()
    assert found is not None and found.count % 3 == 0 and found.count >= 36
    budget = fit.limit / 4.0
    trials = fit._trials(dataclasses.replace(fit.plan, sample_count=found.count))
    coarse, fine = trials((found.count, 1.0, 1.0), (9 * found.count, 1.0, 1.0))
    error = np.abs(coarse["opd"] - fine["opd"]).max()
    assert error <= budget * 1.01 and found.worst <= budget and error == pytest.approx(found.worst, rel=0.1, abs=1e-13)
    again = fit.confirm(found.count)
    assert again is not None and again.count >= found.count and again.worst <= budget
    assert again.searched == found.count and fit.confirm(33) is None  # fewer than the least
    # The rule's own bound falls with the fourth power of the number, which is not computed twice.
    few, many = fit.structure._by_rule(45), fit.structure._by_rule(90)
    assert many == pytest.approx(few / 16.0, rel=1e-12)


def test_fits_become_plans():
    """The number, its error and scales, and a known number confirmed; none where the stop or the grid forbid it."""
    fit = fitting(1e-2)
    given = fit.field, fit.pilot, fit.plan, STOP, 1e-6, fit.some
    plan = leapfrog.fit_leapfrog(*given)
    found = fit.search()
    assert plan.sample_count == found.count and plan.predicted_error == found.worst / 1e-6
    assert (plan.quadrature_error_scale, plan.trajectory_error_scale) == found.scales
    assert plan.predicted_evaluations == found.count and not plan.cubes
    assert "leapfrog samples a ray" in plan.reasons[0]
    alike = leapfrog.fit_leapfrog(*given, like=plan)
    assert alike.sample_count >= plan.sample_count
    field = fit.field
    assert leapfrog.may_be_leapfrog(field, 4096, STOP) and not leapfrog.may_be_leapfrog(field, 4095, STOP)
    assert not leapfrog.may_be_leapfrog(field.with_interpolation("linear"), 9999, None)


def test_rays_that_show_the_extent_of_a_bundle():
    """All of up to 8192; of more the evenly spread ones and the outermost of place, direction and part of the field."""
    rng = np.random.default_rng(215)
    count = 9000
    rays = RayBundle(rng.normal(size=(count, 3)), rng.normal((0.0, 0.0, 4.0), 1.0, (count, 3)))
    low, high = np.array([-1.0, -1.0, 2.0]), np.array([1.0, 1.0, 5.0])
    few = rays.rows(slice(0, 8192))
    assert leapfrog.spread_of("volume", few, None, low, high) is few
    some = leapfrog.spread_of("volume", rays, None, low, high)
    rows = {tuple(one) for one in np.c_[some.position, some.direction]}
    even = np.linspace(0, count - 1, 8192).round().astype(int)
    ends = [one for array in (rays.position, rays.direction) for one in (*array.argmin(axis=0), *array.argmax(axis=0))]
    assert {tuple(one) for one in np.c_[rays.position, rays.direction][[*even, *ends]]} <= rows
    assert len(some) > 8192


class Law(MissedStructure):
    """Structure whose error follows a law of the number of samples, in place of a field's."""

    def __init__(self, limit: float, law):
        self.limit, self.law, self.rule, self.field = limit, law, law, SimpleNamespace(geometry="volume")
        self.lines = Lines(*(np.zeros((1, 3)),) * 2, *(np.ones(1),) * 3)
        self.steepness = (1.0, 1.0, 1.0)

    def _greatest(self, count: int) -> float:
        return self.law(count)

    def _by_rule(self, count: int) -> float:
        return self.rule(count)


def test_the_fewest_samples_by_a_power_law():
    """With an error of (c / N)^4 the least multiple of three with (c / N)^4 <= 0.75: from the first trial or two."""
    assert [multiple_of_three(n) for n in (1, 3.0, 3.1, 6 + 1e-10, 7)] == [3, 3, 6, 6, 9]
    law = Law(1.0, lambda count: (100.0 / count) ** 4)
    least = 3 * math.ceil(100.0 / NEGLIGIBLE**0.25 / 3.0)
    assert NEGLIGIBLE == 0.75 and least == 108
    assert law.enough(60, 300) == least and law.fewest(60, 300) == least
    assert law.enough(120, 300) == 120 and law.enough(60, 90) == 0
    # The same limit in other units; a law that is no power is refined one step at a time.
    small = Law(1e-9, lambda count: 1e-9 * (100.0 / count) ** 4)
    assert small.enough(60, 300) == least and small.enough(60, 90) == 0 and small.enough(120, 300) == 120
    steep = Law(1.0, lambda count: 10.0 * math.exp(-count / 30.0) if count > 70 else 5.0)
    exact = next(n for n in range(72, 400, 3) if 10.0 * math.exp(-n / 30.0) <= 0.75)
    assert steep.fewest(60, 300) == exact
    assert Law(1.0, lambda count: 0.0 if count >= 99 else 9.0).enough(60, 99) == 99


def test_a_known_number_is_kept_or_a_few_are_added():
    """By the rule's own bound if that suffices for up to a half more, by the sharper one else; 0 where none does."""
    law = Law(1.0, lambda count: (100.0 / count) ** 4)
    assert law.sufficient(120) == 120 and law.sufficient(90) == 3 * math.ceil(
        90 * (1.02 * law.rule(90) / 0.75) ** 0.25 / 3
    )
    assert law.sufficient(60) == 0
    law.rule = lambda count: (300.0 / count) ** 4  # says too little
    assert law.sufficient(120) == 120 and law.sufficient(90) == law.enough(90, 135) == 108
    assert law.sufficient(69) == 0
    law.lines = Lines(*(np.zeros((0, 3)),) * 2, *(np.zeros(0),) * 3)
    assert law.sufficient(7) == 7


def test_a_known_number_is_refused_where_the_pilot_finds_it_inaccurate():
    """Although no structure is missed: 36 samples are accurate to 2.6e-6 waves, a quarter of 1e-5."""
    for tolerance, holds in ((1e-4, True), (1e-6, False)):
        fit = fitting(tolerance)
        vars(fit)["structure"] = Law(1.0, lambda count: 0.0)
        assert (fit.confirm(36) is not None) == holds
