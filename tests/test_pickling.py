"""Results, fields and scenes travel: pickled, and to and from processes of a pool that is started afresh."""

import pickle
from dataclasses import fields, is_dataclass

import numpy as np
import pytest

import aerokernels as ak
from aerokernels import flow

SMALL = {"strehl.ray_count": 160, "beam.ray_count": 25, "receiver.ray_count": 64, "grid.spacing": "0.4 mm"}


def same(one, other, path: str = "") -> None:
    """Asserts that two objects hold the same, bit for bit, whatever they are made of."""
    assert type(one) is type(other), path
    if isinstance(one, np.ndarray):
        assert one.dtype == other.dtype and np.array_equal(one, other, equal_nan=one.dtype.kind == "f"), path
    elif is_dataclass(one):
        for entry in fields(one):
            same(getattr(one, entry.name), getattr(other, entry.name), f"{path}.{entry.name}")
    elif isinstance(one, dict):
        assert one.keys() == other.keys(), path
        for key in one:
            same(one[key], other[key], f"{path}[{key!r}]")
    elif isinstance(one, tuple):
        assert len(one) == len(other), path
        for number, (left, right) in enumerate(zip(one, other, strict=True)):
            same(left, right, f"{path}[{number}]")
    elif isinstance(one, float):
        assert one == other or (one != one and other != other), path
    elif isinstance(one, (str, int, type(None), ak.Scene, np.generic)):
        assert one == other, path


def again(thing):
    return pickle.loads(pickle.dumps(thing))


@pytest.fixture(scope="module")
def field() -> ak.IndexField:
    """The flow over a cone, on a coarse grid."""
    return flow.cone(3.0, 0.3).index_field(spacing=2e-3)


PUPIL = ak.Disc(4e-3, (0.0, 0.0, -0.03))
RAYS = ak.RayBundle.collimated(ak.Disc(4e-3, (0.0, 0.02, -0.03)), 32)


def test_fields_rays_and_scenes_come_back_equal(field: ak.IndexField):
    """Read-only arrays stay so; what was computed from the fields and kept (splines, ladders) is not in the pickle."""
    mesh = flow.shipped("mach3").index_field()
    bare = len(pickle.dumps(field))
    _ = mesh.samples.gradients, field.samples.coefficients
    flows = (flow.shipped("mach2"), flow.wedge(2.0, 0.1, spacing=2e-3), flow.cone(3.0, 0.3), flow.vortex(0.3))
    for thing in (field, mesh, mesh.resample(1e-3), *flows, RAYS, PUPIL, ak.Scene.load("wind-tunnel-mach3")):
        same(again(thing), thing, type(thing).__name__)
    assert len(pickle.dumps(field)) == bare
    assert not again(field).samples.samples.flags.writeable and not again(mesh).mesh.vertices.flags.writeable
    with pytest.raises(ValueError, match="read-only"):
        again(RAYS).position[0] = 0.0


def test_a_trace_comes_back_and_still_knows_its_error(field: ak.IndexField):
    result = ak.trace(field, RAYS)
    found = again(result)
    same(found, result, "TraceResult")
    assert np.array_equal(found.status, result.status) and np.array_equal(found.truncation, result.truncation)
    assert found.error == result.error and np.isfinite(found.error["total"])
    assert again(result).error == result.error  # computed before, and carried along


def test_an_estimate_comes_back_and_still_knows_its_error(field: ak.IndexField):
    estimate = ak.estimate_strehl(field, PUPIL, ray_count=160, allow_truncation=True)
    found = again(estimate)
    same(found, estimate, "StrehlEstimate")
    assert found.error == estimate.error and np.isfinite(found.error["total"])
    assert found.quantities == estimate.quantities and repr(found) == repr(estimate)
