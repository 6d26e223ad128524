"""Bundles through a field that other bundles have passed: what is taken from those, and that answers do not change."""

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.rays import Disc, RayBundle
from aerokernels.tracing import ArcLength, Plane, trace
from aerokernels.tracing.bundle import run
from tests.random_fields import CELL
from tests.slow import first_of

from ..backends import ENGINES, WAVE, on

KINDS = ("volume", "planar", "axisymmetric")
STOP = Plane((0.0, 0.0, 6.1e-3), (0.0, 0.1, 1.0))


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


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("slope", first_of([0.03, 0.0]))
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
