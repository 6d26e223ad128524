"""What each backend promises beside right numbers, which test_generated_kernels.py compares to the bit."""

import ctypes
import gc
import re
import weakref
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, RayStatus, launch, trace
from aerokernels.tracing.plan import RAY_OUTPUTS
from tests.random_fields import uniform_field
from tests.small_fields import oblique_rays

from ..backends import (
    ENGINES,
    FAR,
    OPD_LIMIT,
    OPENCL,
    WAVE,
    assert_same_bits,
    exact,
    field_of,
    on,
    small_field,
    small_rays,
)

PRECISIONS = ("float32", "float64")


@pytest.mark.parametrize("engine", ENGINES)
def test_adaptive_on_meshes_keeps_its_tolerance(engine):
    """Rounding shifts where steps end at kinks: held to the reference; a few tolerances, 3e-3 wave at 1e-3.

    `test_adaptive_meets_the_limits` goes through every mesh in float64.
    """
    backend = on(engine)
    field, rays = small_field("axisymmetric", "bilinear", 1, 3.0), small_rays(1)
    expected = exact("axisymmetric", "bilinear", 1, 3.0, "far", 1)
    result = trace(field, rays, until=FAR, method="adaptive", precision="float32", **backend)
    assert result.ok.all() and np.abs(result.opd - expected.opd).max() < 3e-3 * WAVE


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("count", [1, 63, 64, 65, 129, 1000])
def test_any_number_of_rays(engine, count):
    """The first `count` of 1000 rays give what they give in the whole bundle: work-groups have 64 items."""
    backend, field, rays = on(engine), field_of("planar", "cubic"), oblique_rays(1000)
    settings = {"until": FAR, "method": "adaptive", **backend}
    few = RayBundle(rays.position[:count], rays.direction[:count])
    assert_same_bits(trace(field, rays, **settings), trace(field, few, **settings), slice(count))


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("kind", [("volume", "cubic"), ("axisymmetric", "bilinear")])
def test_chunks_of_a_bundle_change_nothing(monkeypatch, engine, kind):
    """Chunks of 128 and a last one of 44 against one chunk: the same bits, whatever outputs are wanted."""
    backend, field, rays = on(engine), field_of(*kind), oblique_rays(300)
    settings = {"until": FAR, "method": "adaptive", **backend}
    whole = trace(field, rays, **settings)
    monkeypatch.setattr(launch, "CHUNK", 128)
    chunked = trace(field, rays, **settings)
    assert_same_bits(whole, chunked)
    assert np.array_equal(whole.evaluation_count, chunked.evaluation_count)
    only = trace(field, rays, outputs=("opd",), **settings)
    assert np.array_equal(only.opd, whole.opd) and np.array_equal(only.status, whole.status)


@pytest.mark.parametrize("engine", OPENCL)
@pytest.mark.parametrize("name", [*RAY_OUTPUTS, "status"])
def test_each_output_comes_alone(engine, name):
    """What was not asked for is None; what was asked for is as in a full trace, in float64 or whole numbers."""
    backend, field, rays = on(engine), field_of("planar", "cubic"), oblique_rays(70)
    settings = {"until": FAR, "method": "adaptive", **backend}
    whole, part = trace(field, rays, **settings), trace(field, rays, outputs=name, **settings)
    assert np.array_equal(getattr(part, name), getattr(whole, name))
    assert getattr(part, name).dtype == getattr(whole, name).dtype
    assert np.array_equal(part.status, whole.status)
    assert [other for other in RAY_OUTPUTS if getattr(part, other) is not None] == [name] * (name in RAY_OUTPUTS)


def memory() -> int:
    """What this process holds [bytes], without what the allocator has free: earlier tests leave much of that."""
    with suppress(OSError, AttributeError):  # another C library
        ctypes.CDLL("libc.so.6").malloc_trim(0)
    found = re.search(r"VmRSS:\s*(\d+) kB", Path("/proc/self/status").read_text())
    return 1024 * int(found[1]) if found else 0


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is measured by Linux's /proc")
@pytest.mark.parametrize("engine", [one for one in ENGINES if not one.marks])
def test_a_field_is_kept_once_as_long_as_it_lives(engine):
    """1.4 million nodes, traced seven times: the same bits, kept once, and given back when the field is let go.

    Samples, and an engine's spline of them in float32, are at least 12 bytes a node; asked for are 8 of them kept
    at first, none more later, and half of all given back (allocators keep some).
    """
    backend, count = on(engine), 1200
    wave = np.linspace(0.0, 2.0 * np.pi, count)
    settings = {"until": Plane((0.0, 0.0, 3.0), (0.0, 0.0, 1.0)), "method": "adaptive", **backend}
    rays = RayBundle(np.c_[np.zeros(5), np.linspace(-0.5, 0.5, 5), np.full(5, -0.1)], [[0.0, 0.0, 1.0]])

    def field(nodes: int) -> IndexField:
        samples = 1e-6 * np.sin(wave[:nodes, None]) * np.cos(wave[:nodes])
        return IndexField.from_samples(samples, origin=(-1.0, 0.0), spacing=(2.0 / nodes,) * 2, geometry="planar")

    trace(field(1100), rays, **settings)  # compiled and loaded before memory is counted, as for as many nodes
    gc.collect()
    before = memory()
    large = field(count)
    first = trace(large, rays, **settings)
    for _ in range(2):  # the allocator keeps some of what has passed through it once or twice
        assert_same_bits(first, trace(large, rays, **settings))
    gc.collect()
    kept = memory() - before
    for _ in range(4):
        assert_same_bits(first, trace(large, rays, **settings))
    gc.collect()
    again = memory() - before
    assert kept > 8 * count**2 and again - kept < 2 * count**2
    alive = weakref.ref(large)
    del large, first
    gc.collect()
    assert alive() is None and memory() - before < 0.5 * again


@pytest.mark.parametrize("engine", ENGINES)
def test_each_precision_has_its_own_numbers_on_the_device(engine):
    """A trace in the other precision between two of one: the same bits before and after."""
    field, rays = uniform_field("planar", amplitude=2e-4), oblique_rays(5)
    settings = {"until": FAR, "method": "adaptive", **on(engine)}
    single, double = (trace(field, rays, precision=precision, **settings) for precision in PRECISIONS)
    assert not np.array_equal(single.opd, double.opd)
    assert_same_bits(single, trace(field, rays, precision="float32", **settings))
    assert_same_bits(double, trace(field, rays, precision="float64", **settings))


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("method", ["adaptive", "fixed"])
def test_every_status_in_one_bundle(engine, method):
    """Rays that arrive, fly past, run away from the plane and run out of steps; each has its own status."""
    backend, field = on(engine), field_of("planar" if method == "fixed" else "volume", "cubic")
    step = {"step": 4e-5} if method == "fixed" else {}
    behind = (0.0, 0.0, 11e-3)
    rays = RayBundle([[0, 0, -1e-3], [0, 1.0, 0], behind, [0, 0, 3.99e-3]], [[0.0, 0.0, 1.0]])
    result = trace(field, rays, until=Plane((0, 0, 10e-3), (0, 0, 1)), method=method, max_steps=3, **step, **backend)
    expected = [RayStatus.MAX_STEPS, RayStatus.OK, RayStatus.STOP_NOT_REACHED, RayStatus.OK]
    assert list(result.traced_status) == expected
    assert list(result.status) == expected  # the last one leaves a box full of disturbed air, which is the whole flow
    assert result.opd[1] == 0.0 and np.isfinite(result.opd).all() and np.isfinite(result.position).all()
    assert result.step_count[0] == 3 and result.evaluation_count[1] == 0
    missed = trace(field, rays[:2], method=method, **step, **backend)
    assert missed.status[1] == RayStatus.MISSED_FIELD


@pytest.mark.parametrize("engine", OPENCL)
@pytest.mark.parametrize("precision", PRECISIONS)
def test_two_fields_take_turns(engine, precision):
    """Two fields of one kind share a program; neither is given the other's buffers or numbers."""
    backend, rays = on(engine), oblique_rays(10)
    first, second = uniform_field("planar"), uniform_field("planar", amplitude=-1e-4, ambient=1.2)
    settings = {"until": FAR, "method": "fixed", "step": 4e-5, "precision": precision, **backend}
    rounds = [[trace(field, rays, **settings) for field in (first, second)] for _ in range(2)]
    assert_same_bits(rounds[0][0], rounds[1][0])
    assert_same_bits(rounds[0][1], rounds[1][1])
    assert np.abs(rounds[0][0].opd - rounds[0][1].opd).min() > OPD_LIMIT["float32"]
