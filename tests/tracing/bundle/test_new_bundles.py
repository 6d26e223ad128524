"""Bundles through a field that other bundles have passed: what is taken from those, and that answers do not change."""

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.medium.grid import local_coordinates
from aerokernels.rays import Disc, RayBundle
from aerokernels.tracing import ArcLength, Plane, trace
from aerokernels.tracing.bundle import run
from aerokernels.tracing.error_limit import error_limit, support_box
from aerokernels.tracing.leapfrog.between_samples import NEGLIGIBLE, SPACING_MARGIN, MissedStructure
from aerokernels.tracing.leapfrog.missed_on_lines import path_of
from aerokernels.tracing.leapfrog.sample_count import SPREAD_RAYS, spread_of
from aerokernels.tracing.straight_lines import lever_arms_of, lines_through, outermost_rays
from tests.random_fields import CELL

from ..backends import ENGINES, WAVE, on

KINDS = ("volume", "planar", "axisymmetric")
STOP = Plane((0.0, 0.0, 6.1e-3), (0.0, 0.1, 1.0))
HALF = 24 * CELL


def field(kind: str = "volume", rough: float = 2e-6) -> IndexField:
    """A smooth blob of some waves' path, with waves of some cells' length that samples may miss."""
    y, z = np.arange(-24, 25) * CELL, np.arange(61) * CELL
    if kind == "axisymmetric":
        y = np.arange(25) * CELL
    axes = (y, y, z) if kind == "volume" else (y, z)
    places = np.meshgrid(*axes, indexing="ij")
    square = sum(place**2 for place in places[:-1])
    along = places[-1] - 3e-3
    blob = np.exp(-square / 0.9e-3**2 - (along / 0.7e-3) ** 2)
    samples = blob * (2e-4 + rough * np.cos(2.0 * np.pi * along / (5.0 * CELL)))
    origin = tuple(axis[0] for axis in axes)
    return IndexField.from_samples(
        samples, origin=origin, spacing=(CELL,) * len(axes), geometry=kind, ambient_index=1.0003
    )


def rays(seed: int, count: int = 20_000, slope: float = 0.03) -> RayBundle:
    """Rays of independent places and directions that start ahead of the box, at z = -1 mm."""
    rng = np.random.default_rng(seed)
    way = np.c_[rng.normal(0.0, slope, (count, 2)), np.ones(count)]
    start = np.c_[rng.uniform(-1e-3, 1e-3, (count, 2)), np.full(count, -1e-3)]
    return RayBundle(start, way)


def structure_of(field: IndexField, rays: RayBundle) -> MissedStructure:
    """The structure that a bundle may miss, as the search for its number of samples makes it."""
    arms = lever_arms_of(field, rays.pilot, STOP)
    limit = error_limit(field, 1e-3 * WAVE)
    return MissedStructure(
        field, spread_of(field.geometry, rays, STOP, *support_box(field, limit, arms)), STOP, limit, arms
    )


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("slope", [0.0, 0.03])
def test_an_answer_does_not_depend_on_earlier_bundles(engine, slope):
    """The same rays through a new field, and through one that four other bundles have passed: equal to the last bit."""
    some, options = rays(1, slope=slope), {"until": STOP, "bundle": "off", "wavelength": WAVE, **on(engine)}
    used = field()
    for seed in (2, 3, 4, 5):
        trace(used, rays(seed, slope=0.02 * seed), **options)
    before, after = trace(field(), some, **options), trace(used, some, **options)
    assert before.plan == after.plan
    for name in ("opd", "position", "direction", "optical_path", "step_error", "status"):
        assert np.array_equal(getattr(before, name), getattr(after, name)), name


@pytest.mark.parametrize("stop", [lambda: Plane((0.0, 0.0, 5e-3), (0.0, 0.1, 1.0)), lambda: ArcLength(6e-3)])
def test_the_same_rays_to_an_equal_stop_are_recognised_once(monkeypatch, stop):
    """Set-up: three calls with one bundle and stops made anew. Expected: its family is looked for once."""
    looked = []
    find = run.find_family
    monkeypatch.setattr(run, "find_family", lambda *given: looked.append(given) or find(*given))
    y, z = np.meshgrid(np.linspace(-2e-3, 2e-3, 41), np.linspace(0.0, 4e-3, 41), indexing="ij")
    air = 1e-5 * np.exp(-(y**2 + (z - 2e-3) ** 2) / 0.5e-3**2)
    layer = IndexField.from_samples(air, origin=(-2e-3, 0.0), spacing=(1e-4, 1e-4), geometry="planar")
    some = RayBundle.collimated(Disc(1e-3, (0.0, 0.0, -1e-3)), 10_000)
    found = [trace(layer, some, until=stop(), wavelength=WAVE) for _ in range(3)]
    assert found[0].plan.bundle is not None and len(looked) == 1
    assert np.array_equal(found[0].opd, found[2].opd)


def test_other_rays_of_a_kind_are_sampled_alike():
    """Ten bundles, whose steepest rays differ by more than a tenth, need the tables of at most five."""
    there = field()
    found = [structure_of(there, rays(seed)) for seed in range(10)]
    steepest = [np.abs(one.lines.direction[:, 0]).max() for one in found]
    assert max(steepest) > 1.1 * min(steepest)
    assert len({(one.length, one.steepness) for one in found}) <= 5


@pytest.mark.parametrize("slope", [0.0, 1e-6, 0.03, 0.4])
def test_rounded_bounds_hold_and_are_close(slope):
    """Steepness is rounded up by at most an eighth of the directions' range, the length down within its margin."""
    bundle = rays(3, slope=slope)
    one = structure_of(field(), bundle)
    steepness, extent = np.abs(bundle.direction).max(axis=0), np.ptp(bundle.direction, axis=0)
    rounded = np.array(one.steepness)
    assert (rounded >= np.minimum(steepness, 1.0)).all()
    assert (rounded <= steepness + extent / 8.0 + 1e-15).all()
    if slope == 0.0:
        assert np.array_equal(rounded, steepness)
    longest = one.lines.length.max()
    assert 1.009 * longest < one.length <= SPACING_MARGIN * longest


def test_the_fewest_samples_are_found():
    """As by trying one count after the other, for structure from none to more than any of them resolves."""
    seen = set()
    for rough in (0.0, 1e-7, 1e-6, 3e-6, 1e-5, 1e-4):
        one = structure_of(field(rough=rough), rays(4))
        counts = range(36, 55, 3)
        enough = [count for count in counts if one._greatest(count) <= NEGLIGIBLE * one.limit]
        assert structure_of(field(rough=rough), rays(4)).fewest(36, 54) == (enough[0] if enough else 0)
        seen.add(enough[0] if enough else 0)
    assert len(seen) > 2 and {0, 36} <= seen


@pytest.mark.parametrize("until", [None, STOP])
@pytest.mark.parametrize("kind", KINDS)
def test_outermost_rays_are_outermost(kind, until):
    """Their lines have all extremes of the bundle's: places, directions, ends in a box, length. Some rays miss it."""
    low, high = np.full(3, -0.8e-3), np.array([0.9e-3, 0.7e-3, 4e-3])
    low[2] = 1e-3
    low, high = (corner[0 if kind == "volume" else 1 :] for corner in (low, high))
    if kind == "axisymmetric":
        low[0] = 0.0
    rng = np.random.default_rng(5)
    start = np.c_[rng.normal(0.0, 1.5e-3, (40_000, 2)), rng.uniform(-2e-3, 3e-3, 40_000)]
    bundle = RayBundle(start, np.c_[rng.normal(0.0, 0.2, (40_000, 2)), np.ones(40_000)])
    rows = outermost_rays(kind, bundle.position, bundle.direction, until, low, high)
    some = bundle.rows(rows)
    for of_all, of_some in ((bundle.position, some.position), (bundle.direction, some.direction)):
        assert np.array_equal(of_all.min(axis=0), of_some.min(axis=0))
        assert np.array_equal(of_all.max(axis=0), of_some.max(axis=0))
    there = field(kind)
    everywhere, found = (lines_through(there, each, until, low, high) for each in (bundle, some))
    assert 1000 < len(everywhere.length) < 39_000
    assert np.isclose(everywhere.length.max(), found.length.max(), rtol=1e-12, atol=0.0)
    for share in (0.0, 1.0):
        ends = [
            local_coordinates(line.start + share * line.length[:, None] * line.direction, kind)
            for line in (everywhere, found)
        ]
        for extreme in (np.min, np.max):
            assert np.allclose(*(extreme(end, axis=0) for end in ends), rtol=0.0, atol=1e-15)


def test_rays_that_miss_the_box_have_outermost_places_all_the_same():
    """None of them meets it; their outermost places and directions are returned."""
    bundle = rays(6)
    low, high = np.array([5e-3, 5e-3, 0.0]), np.array([6e-3, 6e-3, 1e-3])
    rows = outermost_rays("volume", bundle.position, bundle.direction, None, low, high)
    assert np.array_equal(bundle.rows(rows).position.max(axis=0), bundle.position.max(axis=0))


def test_lever_arms_of_layers_are_those_of_the_lines_in_them():
    """Along each line at 2000 places: no place in a layer has a longer lever arm than the layer, and one has it."""
    there = field()
    low, high = support_box(there, error_limit(there, 1e-3 * WAVE))
    lines = lines_through(there, rays(7, SPREAD_RAYS // 8), STOP, low, high)
    path = path_of(lines, "volume", there.samples.low, 4 * there.samples.spacing, (12, 12, 15))
    (layers,) = path.layers  # no line crosses a block along x or y
    share = np.linspace(0.0, 1.0, 2000)
    place = lines.start[:, 2, None] + share * (lines.length * lines.direction[:, 2])[:, None]
    arm = lines.lever_arm[:, None] - lines.tangent[:, None] * share * lines.length[:, None]
    layer = np.floor((place - there.samples.low[2]) / (4 * CELL)).astype(int) - path.part[2].start
    greatest = np.zeros(layers.lever_arms.size)
    np.maximum.at(greatest, layer.ravel(), arm.ravel())
    met = np.unique(layer)
    assert (greatest[met] <= layers.lever_arms.ravel()[met] * (1.0 + 1e-9)).all()
    assert np.allclose(greatest[met], layers.lever_arms.ravel()[met], rtol=0.02)


@pytest.mark.parametrize("engine", ["warp-cpu", "opencl-cpu"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_few_steep_rays_do_not_decide_how_all_are_sampled(engine, kind):
    """Four rays three times as steep as the others are traced again, and the others take no more samples for them."""
    air, here = field(kind), on(engine)
    one, steep = rays(8, slope=0.02), [900, 5_000, 12_345, 17_001]
    way = np.array(one.direction / one.direction[:, 2:])
    way[steep, :2] = np.array([[0.25, 0.2], [-0.22, 0.24], [0.21, -0.27], [-0.2, -0.2]])
    start = np.array(one.position)
    start[steep] = np.array([0.0, 0.0, 3e-3]) - 4e-3 * way[steep]
    both = [RayBundle(start, way), RayBundle(np.delete(start, steep, axis=0), np.delete(way, steep, axis=0))]
    outputs = ("opd", "status", "evaluation_count")
    found, without = (trace(air, each, until=STOP, wavelength=WAVE, outputs=outputs, **here) for each in both)
    assert found.plan.sample_count == without.plan.sample_count > 0
    assert (found.evaluation_count[steep] != found.plan.sample_count).all()
    finer = trace(air, both[0].rows(steep), until=STOP, wavelength=WAVE, tolerance=1e-5, precision="float64", **here)
    assert np.abs(finer.opd).min() > 0.1 * WAVE
    assert np.abs(found.opd[steep] - finer.opd).max() < 1e-3 * WAVE
