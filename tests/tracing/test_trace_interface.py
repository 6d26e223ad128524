"""What `trace` accepts, refuses and returns."""

import numpy as np
import pytest

from aerokernels import IndexField, available_backends
from aerokernels.rays import RayBundle
from aerokernels.tracing import ArcLength, Plane, trace
from aerokernels.tracing.plan import RAY_OUTPUTS
from tests.random_fields import uniform_field
from tests.small_fields import oblique_rays

from .backends import ENGINES, on

FAR = Plane((0.0, 0.0, 10e-3), (0.0, 0.0, 1.0))


def smooth_blob() -> IndexField:
    """A Gaussian in the middle of a volume of 20 mm."""
    place = np.linspace(-1.0, 1.0, 24)
    x, y, z = np.meshgrid(place, place, place, indexing="ij")
    contrast = 1e-5 * np.exp(-4.0 * (x**2 + y**2 + z**2))
    return IndexField.from_samples(contrast, origin=(-1e-2,) * 3, spacing=(2e-2 / 23,) * 3, geometry="volume")


def parallel_rays(count: int) -> RayBundle:
    """Rays along z that start ahead of the volume."""
    across = np.random.default_rng(1).uniform(-5e-3, 5e-3, (count, 2))
    return RayBundle(np.c_[across, np.full(count, -11e-3)], [[0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"method": "euler"}, "method 'euler'.*adaptive"),
        ({"method": "fixed"}, "needs step"),
        ({"method": "fixed", "step": 0.0}, "needs step"),
        ({"method": "fixed", "step": float("nan")}, "needs step"),
        ({"step": 1e-4}, "step belongs to method 'fixed'"),
        ({"tolerance": 0.0}, "tolerance must be positive"),
        ({"tolerance": float("inf")}, "tolerance must be positive"),
        ({"precision": "float16"}, "float32.*float64"),
        ({"backend": "cupy"}, "backend 'cupy'.*warp"),
        ({"backend": "warp", "device": "cuda:7"}, "device 'cuda:7' is not there.*cpu"),
        ({"backend": "reference", "device": "cuda:0"}, "'cpu' only"),
        ({"wavelength": -1.0}, "wavelength"),
        ({"max_steps": 0}, "max_steps"),
        ({"outputs": ["opd", "colour"]}, "colour.*opd"),
    ],
)
def test_bad_arguments_are_refused_by_name(settings, words):
    """Every refusal names the value and what would do."""
    with pytest.raises(ValueError, match=words):
        trace(uniform_field("planar"), oblique_rays(2), until=FAR, **settings)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"step": 1e-4}, "step belongs to method 'fixed', not to 'auto'"),
        ({"tolerance": -1.0}, "tolerance must be positive.*got -1.0"),
    ],
)
def test_many_rays_are_refused_like_few(settings, words):
    """A bundle that is interpolated between a few traced lines has the same checks: the step was ignored there."""
    rays = parallel_rays(12_000)
    assert trace(smooth_blob(), rays).plan.bundle is not None
    for some in (rays, rays[:10]):
        with pytest.raises(ValueError, match=words):
            trace(smooth_blob(), some, **settings)


def test_wrong_kinds_are_type_errors():
    """Objects of the wrong kind."""
    field, rays = uniform_field("planar"), oblique_rays(2)
    for arguments in ((rays, rays), (field, field)):
        with pytest.raises(TypeError, match="must be"):
            trace(*arguments)
    with pytest.raises(TypeError, match="until"):
        trace(field, rays, until=3.0)
    for length in (-1.0, float("nan")):
        with pytest.raises(ValueError, match="ArcLength"):
            ArcLength(length)
    with pytest.raises(ValueError, match="Plane normal"):
        Plane((0, 0, 0), (0, 0, 0))


@pytest.mark.parametrize("engine", [*ENGINES, "reference-cpu"])
def test_only_the_outputs_asked_for_come_back(engine):
    """The others are None; those asked for are as in a full trace."""
    backend = on(engine)
    field, rays = uniform_field("planar"), oblique_rays(3)
    whole = trace(field, rays, until=FAR, **backend)
    part = trace(field, rays, until=FAR, **backend, outputs=("opd", "direction"))
    for name in RAY_OUTPUTS:
        if name in ("opd", "direction"):
            assert np.array_equal(getattr(part, name), getattr(whole, name))
            assert getattr(part, name).dtype == np.float64
        else:
            assert getattr(part, name) is None
    # The budget traces some rays again: it needs none of the arrays.
    assert part.error == whole.error and np.isfinite(whole.error["total"])


@pytest.mark.parametrize("engine", ENGINES)
def test_a_result_tells_its_plan_times_errors_and_units(engine):
    """plan, seconds, error and to_xarray are there and hold together."""
    backend = on(engine)
    field, rays = uniform_field("planar"), oblique_rays(3)
    result = trace(field, rays, until=FAR, **backend)
    assert {"backend": result.plan.backend, "device": result.plan.device} == backend
    assert (
        result.plan.method in ("adaptive", "fixed") and result.plan.reasons and result.plan.method in str(result.plan)
    )
    assert {"compile", "kernel", "total"} <= set(result.seconds)
    assert {"step", "interpolation", "resampling", "precision", "sampling", "total"} <= set(result.error)
    assert result.error["total"] >= result.error["step"] > 0.0
    data = result.to_xarray()
    assert data["opd"].attrs["units"] == "m" and data["position"].dims == ("ray", "axis")
    assert np.array_equal(data["opd"], result.opd)


@pytest.mark.parametrize("engine", ENGINES)
def test_position_and_direction_are_float64_unit_vectors(engine):
    """Directions come back normalised, whatever went in."""
    backend = on(engine)
    rays = RayBundle([[0, 0, -1e-3]], [[0.0, 3.0, 40.0]])
    result = trace(uniform_field("volume"), rays, until=FAR, **backend)
    assert result.position.dtype == np.float64
    assert np.linalg.norm(result.direction[0]) == pytest.approx(1.0, abs=1e-15)


def test_backends_are_listed_with_reasons():
    """Warp's CPU and the reference are always there; what is not there says why."""
    found = {(info.backend, info.device): info for info in available_backends()}
    assert found["warp", "cpu"].available and found["reference", "cpu"].float64
    assert all(info.reason for info in found.values())


def test_names_may_be_numpy_strings():
    """As they come out of an array of labels: the same kernels, the same bits."""
    names = np.array(["volume", "cubic", "adaptive", "float32"])
    field = IndexField.from_samples(
        np.full((4, 4, 4), 1e-4), origin=(0, 0, 0), spacing=(1, 1, 1), geometry=names[0], interpolation=names[1]
    )
    rays = RayBundle((1.0, 1.0, -1.0), (0.0, 0.0, 1.0))
    one = trace(field, rays, method=names[2], precision=names[3])
    other = trace(field, rays, method="adaptive", precision="float32")
    assert type(one.plan.precision) is type(field.geometry) is str and one.opd == other.opd


def test_the_rms_of_a_bundle_counts_rays_by_their_shares():
    """A prism along y: OPD g L y, of two rays with shares 3 and 1; the rms is g L dy sqrt(3) / 4."""
    y = np.linspace(-0.01, 0.01, 9)
    field = IndexField.from_samples(
        np.repeat(1e-6 * y[:, None] / 0.01, 9, axis=1), origin=(-0.01, 0.0), spacing=(2.5e-3, 2.5e-3), geometry="planar"
    )
    rays = RayBundle(
        np.array([[0.0, -4e-3, -1e-3], [0.0, 4e-3, -1e-3]]), np.array([[0.0, 0.0, 1.0]]), np.array([3.0, 1.0])
    )
    found = trace(field, rays, backend="reference", precision="float64")
    expected = 1e-6 * 0.02 * 0.8 * np.sqrt(3.0) / 4.0
    assert found.quantities["opd_rms"].value == pytest.approx(expected, rel=1e-4)
