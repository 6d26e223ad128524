"""Warp kernels against the float64 reference, which shares no formula with them."""

import numpy as np
import pytest

from aerokernels.rays import RayBundle
from aerokernels.tracing import ArcLength, Plane, RayStatus, trace

from .fields import mesh_field, slanted_rays, uniform_field

WAVE = 905e-9
FAR = Plane((0.0, 0.0, 10e-3), (0.0, 0.2, 1.0))
WITHIN = Plane((0.0, 0.0, 2e-3), (0.0, 0.2, 1.0))
KINDS = [(g, i) for g in ("volume", "planar", "axisymmetric") for i in ("cubic", "linear", "monotone")]
MESHES = [("planar", i) for i in ("bilinear", "bilinear-barron", "idw")] + [("axisymmetric", "bilinear")]


def field_of(geometry: str, interpolation: str):
    """A grid or a mesh field, told apart by the interpolation."""
    if interpolation in ("cubic", "linear", "monotone"):
        return uniform_field(geometry, interpolation)
    return mesh_field(interpolation, geometry)


@pytest.mark.parametrize(("geometry", "interpolation"), KINDS + MESHES)
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_fixed_steps_agree_step_by_step(geometry, interpolation, precision):
    """The same scheme with the same steps in both: what differs is rounding.

    float64: 1e-9 wave and 1e-13 rad. float32: 1e-3 wave and 5e-7 rad asked for; the deviation form does far better.
    """
    field, rays = field_of(geometry, interpolation), slanted_rays(3)
    expected = trace(field, rays, method="fixed", step=4e-5, until=FAR, backend="reference", precision="float64")
    result = trace(field, rays, method="fixed", step=4e-5, until=FAR, precision=precision)
    assert (result.status == RayStatus.OK).all() and (expected.status == RayStatus.OK).all()
    opd, angle = (1e-7, 1e-12) if precision == "float64" else (1e-4, 1e-8)
    assert np.abs(result.opd - expected.opd).max() < opd * WAVE
    assert np.abs(result.direction - expected.direction).max() < angle
    assert np.abs(result.optical_path - expected.optical_path).max() < opd * WAVE + 1e-15
    assert np.array_equal(result.step_count, expected.step_count)


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
@pytest.mark.parametrize(
    "until", [FAR, WITHIN, None, ArcLength(3.1e-3), ArcLength(9e-3)], ids=["far", "within", "box", "arc", "long-arc"]
)
def test_adaptive_meets_its_tolerance_at_every_stop(geometry, until):
    """DOP853 at 1e-11 is the answer; the tolerance is 1e-3 wave, and the reported step error is no smaller than 1/3."""
    field, rays = uniform_field(geometry), slanted_rays(2)
    expected = trace(field, rays, until=until, backend="reference", precision="float64")
    for precision in ("float32", "float64"):
        result = trace(field, rays, until=until, method="adaptive", tolerance=1e-3, precision=precision)
        assert (result.status == RayStatus.OK).all()
        off = np.abs(result.opd - expected.opd)
        assert off.max() < 1e-3 * WAVE
        assert (off < 3.0 * result.step_error + 2e-5 * WAVE).all()
        assert np.abs(result.direction - expected.direction).max() < 5e-7
        assert np.abs(result.position - expected.position).max() < 5e-9
        assert np.abs(result.arc_length - expected.arc_length).max() < 2e-3 * WAVE


def test_straight_is_right_to_second_order():
    """The straight method's OPD error falls with the cube of the contrast, on a plane square to the rays.

    (On a plane aslant, the first-order error of the landing point would show in second order.)
    """
    along = np.array([0.03, -0.02, 1.0])
    rays = RayBundle(slanted_rays(4).position, np.tile(along, (4, 1)))
    square = Plane((0.0, 0.0, 6e-3), along)
    off = []
    for amplitude in (4e-3, 1e-3):
        field = uniform_field("volume", amplitude=amplitude)
        exact = trace(field, rays, until=square, method="adaptive", tolerance=1e-6, precision="float64")
        straight = trace(field, rays, until=square, method="straight", tolerance=1e-6, precision="float64")
        off.append(np.abs(straight.opd - exact.opd).max())
    # Cubic: 4^3 = 64; between 4^2.5 and 4^3.5 allowed, since the tolerance of 1e-6 wave adds to the smaller one.
    assert 32.0 < off[0] / off[1] < 128.0


@pytest.mark.parametrize("method", ["paper", "fixed"])
def test_paper_steps_follow_eq_5(method):
    """The step rule of eq 5 is the same table in both: equal step counts, equal paths."""
    field, rays = mesh_field("idw"), slanted_rays(3)
    step = {"step": 5e-5} if method == "fixed" else {}
    expected = trace(field, rays, method=method, until=FAR, backend="reference", precision="float64", **step)
    result = trace(field, rays, method=method, until=FAR, precision="float64", **step)
    assert np.array_equal(result.step_count, expected.step_count)
    assert np.abs(result.opd - expected.opd).max() < 1e-6 * WAVE


def test_strong_contrast_agrees():
    """Contrast 0.2 on 1.3: nothing in the deviation form needs the contrast to be small."""
    field, rays = uniform_field("volume", amplitude=0.2, ambient=1.3), slanted_rays(2)
    expected = trace(field, rays, until=FAR, backend="reference", precision="float64")
    for precision, opd in (("float64", 1e-3), ("float32", 1e-2)):
        result = trace(field, rays, until=FAR, method="adaptive", tolerance=1e-4, precision=precision)
        assert np.abs(result.opd - expected.opd).max() < opd * WAVE
        assert np.abs(result.direction - expected.direction).max() < 1e-6


def test_chunks_over_threads_change_nothing():
    """A bundle of several chunks gives each ray what it gets alone."""
    field = uniform_field("planar")
    rng = np.random.default_rng(7)
    position = np.c_[rng.uniform(-0.8e-3, 0.8e-3, (10_000, 2)), np.full(10_000, -1e-3)]
    direction = np.c_[rng.normal(0.0, 0.05, (10_000, 2)), np.ones(10_000)]
    rows = [0, 4095, 4096, 9_999]
    many = trace(field, RayBundle(position, direction), until=FAR, method="adaptive")
    few = trace(field, RayBundle(position[rows], direction[rows]), until=FAR, method="adaptive")
    for name in ("opd", "position", "direction", "step_count"):
        assert np.array_equal(getattr(many, name)[rows], getattr(few, name))
