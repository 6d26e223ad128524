"""Rejected rays that are traced again on the device, right after their chunk: which ones, and with what results."""

from dataclasses import replace
from functools import cache
from importlib import import_module

import numpy as np
import pytest

from aerokernels import IndexField, Plane, RayBundle
from aerokernels.device_arrays import on_host, rows_where
from aerokernels.tracing import launch, retrace
from aerokernels.tracing.engines import Prepared, engine_of
from aerokernels.tracing.plan import TracePlan
from aerokernels.tracing.planning import make_plan
from aerokernels.tracing.result import RAY_OUTPUTS
from aerokernels.tracing.retry import Retry
from aerokernels.tracing.trace import run_plan

from ..backends import ENGINES, WAVE, on

H = 1e-4
SHAPE = (14, 15, 18)
STOP = Plane((0.0, 0.0, (SHAPE[2] - 1) * H), (0.0, 0.0, 1.0))
COUNT, CHUNK, TOLERANCE = 3000, 700, 1e-3
OUTPUTS = frozenset(RAY_OUTPUTS)


@cache
def field() -> IndexField:
    """A wide blob, with a needle of some cells' width that polynomials of cubes do not hold."""
    x, y, z = np.meshgrid(*(np.arange(count) - 0.5 * (count - 1) for count in SHAPE), indexing="ij")
    made = 6e-4 * np.exp(-(x**2 + y**2 + (0.5 * z) ** 2) / 400.0)
    made += 1e-4 * np.exp(-((x - 2.0) ** 2 + (y - 1.0) ** 2) / 3.0)
    return IndexField.from_samples(made, origin=(0.0, 0.0, 0.0), spacing=(H,) * 3, geometry="volume", wavelength=WAVE)


@cache
def rays(count: int = COUNT) -> RayBundle:
    """Incoherent ones from the face z = 0, a tenth of which leave the box through its sides or miss it."""
    rng = np.random.default_rng(3)
    start = np.c_[rng.uniform(-1.0 * H, 14.0 * H, (count, 2)), np.zeros(count)]
    return RayBundle(start, np.c_[rng.normal(0.0, 0.02, (count, 2)), np.ones(count)])


def plan(engine: str) -> TracePlan:
    """Leapfrog samples of cubes, with scales of the errors as a pilot finds them."""
    choices = {"step": None, "max_steps": None, "path_length": None, "wavelength": WAVE, "precision": "float32"}
    choices |= {"tolerance": TOLERANCE, "directions": rays().direction, **on(engine)}
    made = make_plan(field(), method="straight", **choices)
    scales = {"quadrature_error_scale": 1200.0, "trajectory_error_scale": 0.05}
    return replace(made, method="leapfrog", sample_count=36, cubes=True, **scales)


def in_pieces(engine, keeps: bool, monkeypatch) -> None:
    """Let an engine trace CHUNK rays at a time, as one that keeps all results or as one that does not."""
    pieces = [slice(first, min(first + CHUNK, COUNT)) for first in range(0, COUNT, CHUNK)]
    bring = type(engine).bring
    monkeypatch.setattr(launch, "CHUNK", CHUNK)
    monkeypatch.setattr(engine, "keeps", lambda size: keeps)
    monkeypatch.setattr(engine, "bring", lambda starts: (bring(engine, starts)[0], pieces))


def prepared(engine, name: str) -> list[Prepared]:
    """The kernels of `plan` with cubes and with the spline."""
    return [
        engine.prepare(field(), replace(plan(name), cubes=cubes), STOP, WAVE, OUTPUTS, rays().direction)
        for cubes in (True, False)
    ]


def refuse_above(engine, most: int, monkeypatch) -> None:
    """Let larger buffers not fit, as Warp reports it."""

    def empty(count: int, *given, **named):
        if count > most:
            raise RuntimeError(f"Failed to allocate {count} rows")
        return type(engine).empty(engine, count, *given, **named)

    monkeypatch.setattr(engine, "empty", empty)


def like_a_gpu(name: str, monkeypatch) -> dict[str, str]:
    """`on`, for rays each on its own: a processor's may share roundings, and Warp's counters are not atomic there."""
    found = on(name)
    module = import_module(f"aerokernels.tracing.engines.{found['backend']}.engine")
    monkeypatch.setattr(module, {"opencl": "lane_count", "warp": "core_count"}[found["backend"]], lambda *given: 1)
    return found


@pytest.mark.parametrize("room", [64, 4096])
@pytest.mark.parametrize("name", ENGINES)
def test_those_that_the_spline_holds_have_its_results(name: str, room: int, monkeypatch):
    """Set-up: chunks of 700 rays, of which hundreds are above the limit by cubes, and some by the spline too.

    Expected: the spline's bits where its error is within the limit and that of the cubes is not, as many a chunk as
    there are places for; else the cubes'. The counter has the rest. Rays without bound are not tried.
    """
    engine, limit = engine_of(**like_a_gpu(name, monkeypatch)), TOLERANCE * WAVE
    chunk = np.arange(COUNT) // CHUNK
    cubes, spline = prepared(engine, name)

    def traced(ready, retry=None) -> dict[str, np.ndarray]:
        return on_host(launch.in_chunks(ready, launch.starts_of(rays()), OUTPUTS, retry))

    before, after = traced(cubes), traced(spline)
    error = before["step_error"]
    tried = (error > limit) & np.isfinite(error)
    held = tried & (after["step_error"] <= limit)
    assert 100 < held.sum() < tried.sum() < (error > limit).sum()
    for keeps in (False, True)[: 1 + name.startswith("warp")]:
        in_pieces(engine, keeps, monkeypatch)
        cubes.take_rejected()
        found = traced(cubes, lambda size: Retry(spline, limit, float(np.float32(limit)), min(room, size)))
        taken = tried & (found["step_error"] != error)
        assert (taken <= held).all()
        each = np.bincount(chunk, held)
        delivered = np.bincount(chunk, taken)
        assert (delivered == each).all() if room > CHUNK else (delivered <= room).all() and (each > room).all()
        assert delivered.all()
        for what, array in found.items():
            rows = taken if array.ndim == 1 else taken[:, None]
            assert np.array_equal(array, np.where(rows, after[what], before[what])), what
        assert cubes.take_rejected() == (found["step_error"] > limit).sum()


@pytest.mark.parametrize("name", ENGINES)
def test_only_what_it_leaves_is_traced_again_afterwards(name: str, monkeypatch):
    """The same bits as without; of nearly a thousand rays the spline's next attempt gets a few."""
    like_a_gpu(name, monkeypatch)
    asked: list[tuple[int, bool]] = []

    def asking(field, rays, attempt, *given, **named):
        asked.append((rays.ray_count, attempt.method == "leapfrog"))
        return launch.launch(field, rays, attempt, *given, **named)

    def engine(backend: str, device: str):
        made = engine_of(backend, device)
        made.is_gpu = bool(found)  # the second time
        return made

    monkeypatch.setattr(retrace, "launch", asking)
    monkeypatch.setattr(launch, "engine_of", engine)
    found: list[dict[str, np.ndarray]] = []
    attempts = []
    for _ in range(2):
        found.append(on_host(run_plan(field(), rays(), plan(name), STOP, WAVE, OUTPUTS)))
        attempts.append([count for count, by_spline in asked if by_spline])
        asked.clear()
    assert attempts[0][0] > 900 and 0 < attempts[1][0] < 10
    for what, array in found[0].items():
        assert np.array_equal(array, found[1][what]), what


@pytest.mark.parametrize("name", ENGINES)
def test_it_needs_no_more_memory_than_a_chunk(name: str, monkeypatch):
    """Set-up: buffers of more than 100 rows do not fit. Expected: as many rays within the limit as with all room."""
    engine, limit, left = engine_of(**like_a_gpu(name, monkeypatch)), TOLERANCE * WAVE, []
    in_pieces(engine, False, monkeypatch)
    cubes, spline = prepared(engine, name)
    for most in (COUNT, 100):
        refuse_above(engine, most, monkeypatch)
        arrays = launch.in_chunks(
            cubes, launch.starts_of(rays()), OUTPUTS, lambda size: Retry(spline, limit, limit, size)
        )
        left.append(((arrays["step_error"] > limit).sum(), cubes.take_rejected()))
    assert left[0] == left[1] and 0 < left[0][0] == left[0][1] < 100


@pytest.mark.parametrize("name", ENGINES)
def test_chunks_without_a_rejected_ray_have_no_error_left_to_chance(name: str, monkeypatch):
    """Set-up: step_error is not asked for, and new memory holds NaN; one ray, of the last chunk, is rejected.

    Expected: that ray alone is traced again.
    """
    engine = engine_of(**on(name))
    in_pieces(engine, False, monkeypatch)
    monkeypatch.setattr(engine, "room", lambda shape, kind: np.full(shape, np.nan if kind is np.float64 else -1, kind))
    start, ahead = np.full((COUNT, 3), [2.0 * H, 2.0 * H, 0.0]), np.tile([0.0, 0.0, 1.0], (COUNT, 1))
    start[-1] = 8.5 * H, 8.0 * H, 0.0  # along the needle
    by_cubes = replace(plan(name), quadrature_error_scale=0.5)
    ready = engine.prepare(field(), by_cubes, STOP, WAVE, frozenset(("opd",)), ahead)
    arrays = launch.in_chunks(ready, (start, ahead), frozenset(("opd",)))
    assert rows_where(arrays["status"], -1, arrays["step_error"], TOLERANCE * WAVE).tolist() == [COUNT - 1]
