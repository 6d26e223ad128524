"""Backends and devices that a contract is tested on, skipped with the reason where they are not there; the oracle."""

import functools

import numpy as np
import pytest

from aerokernels.rays import RayBundle
from aerokernels.tracing import ArcLength, Plane, TraceResult, available_backends, trace
from tests.random_fields import mesh_field, uniform_field
from tests.small_fields import oblique_rays, random_field

from .stepped_reference import trace_in_steps

WAVE = 905e-9
# What is asked of every backend against the float64 reference: OPD [m] and direction [rad].
OPD_LIMIT = {"float32": 1e-3 * WAVE, "float64": 1e-5 * WAVE}
DIRECTION_LIMIT = {"float32": 5e-7, "float64": 1e-8}

GRID_INTERPOLATIONS = ("cubic", "linear", "monotone")
GRIDS = [(g, i) for g in ("volume", "planar", "axisymmetric") for i in GRID_INTERPOLATIONS]
MESHES = [(g, i) for g in ("planar", "axisymmetric") for i in ("bilinear", "bilinear-barron", "idw")]
KINDS = GRIDS + MESHES


def _precision(geometry: str, interpolation: str) -> str:
    """The precision in which fixed steps are tested on a kind: they take turns.

    Each interpolation and each geometry has both, and no kernel has a part that only one geometry with one
    interpolation in one precision goes through; to build each kernel takes both engines six seconds.
    """
    turn = ("volume", "planar", "axisymmetric").index(geometry)
    turn += interpolation in ("cubic", "monotone")
    turn += ("bilinear", "bilinear-barron", "idw").index(interpolation) if (geometry, interpolation) in MESHES else 0
    return ("float32", "float64")[turn % 2]


FIXED_STEPS = [(*kind, _precision(*kind)) for kind in KINDS]

STOPS = {
    "far": Plane((0.0, 0.0, 10e-3), (0.0, 0.2, 1.0)),
    "within": Plane((0.0, 0.0, 0.7e-3), (0.0, 0.2, 1.0)),
    "box": None,
    "arc": ArcLength(1.1e-3),
    "long-arc": ArcLength(9e-3),
}
FAR = STOPS["far"]


def precisions_at(geometry: str, stop: str) -> tuple[str, ...]:
    """The precisions in which error control on cubic grids is tested at a stop: both, and one by turns at an arc.

    What differs between precisions has no part of its own for a geometry at an arc.
    """
    if "arc" not in stop:
        return "float32", "float64"
    return (("float64", "float32")[("volume", "planar", "axisymmetric").index(geometry) % 2],)


# The best device of each kind; names, so that tests are collected without a look at drivers.
WARP = [pytest.param("warp-cpu"), pytest.param("warp-gpu", marks=pytest.mark.gpu)]
OPENCL = [pytest.param("opencl-cpu"), pytest.param("opencl-gpu", marks=pytest.mark.gpu)]
ENGINES = WARP + OPENCL


def on(engine: str) -> dict[str, str]:
    """`backend` and `device` of an engine such as "opencl-cpu"; the test is skipped where it is not there."""
    found = _found(engine)
    if isinstance(found, str):
        pytest.skip(found)
    return dict(found)


def all_on(kind: str) -> list[dict[str, str]]:
    """`backend` and `device` of each engine that is there on a "cpu" or a "gpu"; the test is skipped without any."""
    found = [_found(f"{backend}-{kind}") for backend in ("warp", "opencl")]
    if not (there := [dict(one) for one in found if not isinstance(one, str)]):
        pytest.skip("; ".join(map(str, found)))
    return there


@functools.cache
def _found(engine: str) -> dict[str, str] | str:
    backend, _, kind = engine.partition("-")
    there = [info for info in available_backends() if info.backend == backend]
    for info in there:
        if info.available and info.is_gpu == (kind == "gpu"):
            return {"backend": backend, "device": info.device}
    missing = "; ".join(info.reason for info in there if not info.available)
    return f"no {kind.upper()} for backend {backend} here" + (f": {missing}" if missing else "")


@functools.cache
def field_of(geometry: str, interpolation: str):
    """The field of a kind, a grid or a mesh as the interpolation tells; one for all tests."""
    if interpolation in GRID_INTERPOLATIONS:
        return uniform_field(geometry, interpolation)
    return mesh_field(interpolation, geometry)


@functools.cache
def small_field(geometry: str, interpolation: str, seed: int, width: float):
    """`random_field`, one for all tests."""
    return random_field(geometry, interpolation, seed, width)


@functools.cache
def stepped(geometry: str, interpolation: str, step: float | None = None):
    """`trace_in_steps` on `field_of` to FAR: three of `oblique_rays`."""
    return trace_in_steps(field_of(geometry, interpolation), oblique_rays(3), until=FAR, step=step)


def small_rays(count: int, seed: int = 8) -> RayBundle:
    """Rays from 0.3 mm ahead of a `random_field` into it, within 0.1 rad of the axis."""
    rng = np.random.default_rng(seed)
    position = np.c_[rng.uniform(-0.3e-3, 0.3e-3, (count, 2)), np.full(count, -0.3e-3)]
    return RayBundle(position, np.c_[rng.normal(0.0, 0.04, (count, 2)), np.ones(count)])


@functools.cache
def exact(geometry: str, interpolation: str, seed: int, width: float, stop: str, count: int, method="adaptive"):
    """DOP853 at 1e-11 on `small_field`: "adaptive", or "straight" along the undisturbed line."""
    settings = {"method": method, "backend": "reference", "precision": "float64", "until": STOPS[stop]}
    return trace(small_field(geometry, interpolation, seed, width), small_rays(count), **settings)


def assert_within_limits(result: TraceResult, expected: TraceResult, precision: str, factor: float = 1.0) -> None:
    """The same rays arrive, OPD and direction within the limits of the precision, the OPD within `factor` times its.

    A tolerance below what the precision can hold may be told of by a ray's status.
    """
    assert np.array_equal(result.ok, expected.ok)
    assert np.abs(result.opd - expected.opd).max() < factor * OPD_LIMIT[precision]
    assert np.abs(result.direction - expected.direction).max() < DIRECTION_LIMIT[precision]


def assert_same_bits(first: TraceResult, second: TraceResult, rows=slice(None)) -> None:
    """Every array of the second is that of the first, of its rows, in every bit."""
    for name in ("position", "direction", "optical_path", "opd", "arc_length", "step_error", "step_count", "status"):
        assert np.array_equal(getattr(first, name)[rows], getattr(second, name)), name
