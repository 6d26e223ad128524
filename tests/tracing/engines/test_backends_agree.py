"""Kernels of every backend against the float64 reference, which shares no formula with them."""

import functools

import numpy as np
import pytest

from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, RayStatus, trace
from tests.random_fields import uniform_field
from tests.slow import first_of
from tests.small_fields import oblique_rays

from ..backends import (
    DIRECTION_LIMIT,
    ENGINES,
    FAR,
    FIXED_STEPS,
    OPD_LIMIT,
    STOPS,
    WAVE,
    exact,
    field_of,
    on,
    precisions_at,
    small_field,
    small_rays,
    stepped,
)

# Every interpolation and every geometry, in precisions by turns: no kernel has a part for one pair of them alone.
PAIRS = (
    ("volume", "cubic"),
    ("planar", "linear"),
    ("axisymmetric", "monotone"),
    ("axisymmetric", "bilinear"),
    ("planar", "bilinear-barron"),
    ("planar", "idw"),
)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    ("geometry", "interpolation", "precision"), first_of(sorted(FIXED_STEPS, key=lambda kind: kind[:2] not in PAIRS), 4)
)
def test_fixed_steps_agree_step_by_step(geometry, interpolation, precision, engine):
    """The same scheme with the same steps in both: what differs is rounding.

    float64: 1e-7 wave and 1e-12 rad. float32: 1e-3 wave and 5e-7 rad asked for; the deviation form does far better.
    """
    backend = on(engine)
    field, rays = field_of(geometry, interpolation), oblique_rays(3)
    expected = stepped(geometry, interpolation, 4e-5)
    result = trace(field, rays, method="fixed", step=4e-5, until=FAR, precision=precision, **backend)
    assert result.ok.all() and expected.ok.all()
    opd, angle = (1e-7, 1e-12) if precision == "float64" else (1e-4, 1e-8)
    assert np.abs(result.opd - expected.opd).max() < opd * WAVE
    assert np.abs(result.direction - expected.direction).max() < angle
    assert np.abs(result.optical_path - expected.optical_path).max() < opd * WAVE + 1e-15
    assert np.array_equal(result.step_count, expected.step_count)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
@pytest.mark.parametrize("stop", STOPS)
def test_adaptive_meets_its_tolerance_at_every_stop(geometry, stop, engine):
    """DOP853 at 1e-11 is the answer; the tolerance is 1e-3 wave, and the reported step error is no smaller than 1/3."""
    backend = on(engine)
    field, rays, until = small_field(geometry, "cubic", 3, 3.0), small_rays(2), STOPS[stop]
    expected = exact(geometry, "cubic", 3, 3.0, stop, 2)
    for precision in precisions_at(geometry, stop):
        result = trace(field, rays, until=until, method="adaptive", tolerance=1e-3, precision=precision, **backend)
        assert result.ok.all()
        off = np.abs(result.opd - expected.opd)
        assert off.max() < 1e-3 * WAVE
        assert (off < 3.0 * result.step_error + 2e-5 * WAVE).all()
        assert np.abs(result.direction - expected.direction).max() < 5e-7
        assert np.abs(result.position - expected.position).max() < 5e-9
        assert np.abs(result.arc_length - expected.arc_length).max() < 2e-3 * WAVE


@functools.cache
def exact_straight(geometry: str, stop: str):
    """The reference along straight lines."""
    settings = {"until": STOPS[stop], "method": "straight", "backend": "reference", "tolerance": 1e-6}
    return trace(small_field(geometry, "cubic", 3, 0.1), small_rays(2), **settings)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    ("geometry", "stop", "precision"),
    [
        ("volume", "far", "float64"),
        ("planar", "within", "float64"),
        ("axisymmetric", "box", "float64"),
        ("planar", "arc", "float32"),
        ("planar", "long-arc", "float32"),
    ],
)
def test_straight_rays_end_at_the_same_place_on_every_backend(geometry, stop, precision, engine):
    """The same first- and second-order terms: they differ by third-order terms and the tolerance, 1e-3 wave.

    Every geometry and every stop: what a geometry has for one stop alone, the test above goes through.
    In float64 where rays are above the tolerance, and would be traced again in it.
    The reference says of rays that what a straight line neglects is above its tighter tolerance.
    """
    backend = on(engine)
    field, rays, until = small_field(geometry, "cubic", 3, 0.1), small_rays(2), STOPS[stop]
    expected = exact_straight(geometry, stop)
    result = trace(field, rays, until=until, method="straight", tolerance=1e-3, precision=precision, **backend)
    judged = expected.status != RayStatus.TOLERANCE_NOT_MET
    assert np.array_equal(result.status[judged], expected.status[judged]) and result.ok.all()
    assert np.abs(result.opd - expected.opd).max() < 1e-3 * WAVE
    assert np.abs(result.position - expected.position).max() < 5e-9
    assert np.abs(result.arc_length - expected.arc_length).max() < 2e-3 * WAVE


@pytest.mark.parametrize("engine", ENGINES)
def test_straight_is_right_to_second_order(engine):
    """The straight method's OPD error falls with the cube of the contrast, on a plane square to the rays.

    (On a plane aslant, the first-order error of the landing point would show in second order.)
    """
    backend = on(engine)
    along = np.array([0.03, -0.02, 1.0])
    rays = RayBundle(oblique_rays(4).position, np.tile(along, (4, 1)))
    square = Plane((0.0, 0.0, 6e-3), along)
    off = []
    settings = {"until": square, "tolerance": 1e-6, "precision": "float64", **backend}
    for amplitude in (4e-3, 1e-3):
        field = uniform_field("volume", amplitude=amplitude)
        bent = trace(field, rays, method="adaptive", **settings)
        straight = trace(field, rays, method="straight", **settings)
        off.append(np.abs(straight.opd - bent.opd).max())
    # Cubic: 4^3 = 64; between 4^2.5 and 4^3.5 allowed, since the tolerance of 1e-6 wave adds to the smaller one.
    assert 32.0 < off[0] / off[1] < 128.0


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    ("geometry", "interpolation", "precision"), first_of([kind for kind in FIXED_STEPS if kind[:2] in PAIRS], 2)
)
def test_paper_steps_follow_eq_5(geometry, interpolation, precision, engine):
    """The step rule of eq 5 is the same table in both: equal step counts, equal paths.

    In float32 a step may start on the other side of a cell's edge than in float64, and have its neighbour's length:
    the limits asked for hold, those of equal steps only where the counts are equal.
    """
    backend = on(engine)
    field, rays = field_of(geometry, interpolation), oblique_rays(3)
    expected = stepped(geometry, interpolation)
    result = trace(field, rays, method="paper", until=FAR, precision=precision, **backend)
    assert result.ok.all() and expected.ok.all()
    off = np.abs(result.opd - expected.opd), np.abs(result.direction - expected.direction).max(axis=1)
    assert off[0].max() < OPD_LIMIT[precision] and off[1].max() < DIRECTION_LIMIT[precision]
    same = result.step_count == expected.step_count
    if precision == "float64":
        assert same.all() and off[0].max() < 1e-7 * WAVE and off[1].max() < 1e-12
    else:
        assert (off[0][same] < 1e-4 * WAVE).all()


@functools.cache
def strong():
    """Field, rays, and where the reference takes them."""
    field, rays = uniform_field("volume", amplitude=0.2, ambient=1.3), oblique_rays(1)
    settings = {"method": "adaptive", "backend": "reference", "precision": "float64"}
    return field, rays, trace(field, rays, until=FAR, **settings)


@pytest.mark.parametrize("engine", ENGINES)
def test_strong_contrast_agrees(engine):
    """Contrast 0.2 on 1.3: nothing in the deviation form needs the contrast to be small."""
    backend = on(engine)
    field, rays, expected = strong()
    for precision, opd in (("float64", 1e-3), ("float32", 1e-2)):
        result = trace(field, rays, until=FAR, method="adaptive", tolerance=1e-4, precision=precision, **backend)
        assert np.abs(result.opd - expected.opd).max() < opd * WAVE
        assert np.abs(result.direction - expected.direction).max() < 1e-6
