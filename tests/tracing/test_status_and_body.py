"""Every way a ray can end, the body in its way, and that one ray's failure leaves the others alone."""

import numpy as np
import pytest

from aerokernels.medium import Body, IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import ArcLength, Plane, RayStatus, trace
from tests.random_fields import uniform_field
from tests.small_fields import oblique_rays

from .backends import ENGINES, on

UP = (0.0, 0.0, 1.0)
BELL = np.sin(np.pi * np.arange(21) / 20.0) ** 4
SMOOTH = 1e-6 * BELL[:, None, None] * BELL[:, None] * BELL


def one(position, direction, field=None, **settings):
    """Trace one ray."""
    return trace(field or uniform_field("volume"), RayBundle([position], [direction]), **settings)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_ray_that_misses_the_box(engine):
    """No box, no exit: a status. A plane or a length is reached all the same, with no OPD. The second ray meets it."""
    backend = on(engine)
    rays = RayBundle([(1.0, 0.0, 0.0), (0.0, 0.0, -1e-3)], UP)
    assert trace(uniform_field("volume"), rays, **backend).status[0] == RayStatus.MISSED_FIELD
    for until, end in ((Plane((0, 0, 2.0), UP), 2.0), (ArcLength(2.0), 2.0)):
        result = trace(uniform_field("volume"), rays, until=until, **backend)
        assert result.ok[0] and result.opd[0] == 0.0 and result.evaluation_count[0] == 0
        assert result.position[0] == pytest.approx([1.0, 0.0, end], abs=1e-15)
        assert result.optical_path[0] == pytest.approx(2.0 * 1.0001, rel=1e-15)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("normal", [UP, (1.0, 0.0, 0.0)])
def test_a_plane_that_is_never_reached(normal, engine):
    """Behind the ray, or parallel to it."""
    backend = on(engine)
    result = one((0, 0, -1e-3), UP, until=Plane((5e-3, 0, -2e-3), normal), **backend)
    assert result.status[0] == RayStatus.STOP_NOT_REACHED
    assert np.isfinite(result.position).all() and np.isfinite(result.opd).all()


@pytest.mark.parametrize("engine", [*ENGINES, "reference"])
def test_a_plane_almost_parallel_to_the_rays_is_parallel(engine):
    """Their straight lines meet it a thousand million times as far away as it is; took all steps before it gave up.

    The plane lies beside the box: rays are those of a plane that is exactly parallel.
    """
    backend = {"backend": "reference"} if engine == "reference" else on(engine)
    field = IndexField.from_samples(SMOOTH, origin=(-1e-3, -1e-3, 0.0), spacing=(1e-4,) * 3, geometry="volume")
    rays = RayBundle([[-3e-4, 2e-4, -1e-3], [0.0, 0.0, -1e-3], [6e-4, 1e-4, -1e-3]], UP)
    parallel, *almost = (
        trace(field, rays, until=Plane((5e-3, 0.0, -2e-3), (1.0, 0.0, slope)), **backend)
        for slope in (0.0, 1e-12, 0.99e-9)
    )
    assert (parallel.status == RayStatus.STOP_NOT_REACHED).all() and (parallel.step_count < 1000).all()
    for result in almost:
        assert np.array_equal(result.status, parallel.status)
        np.testing.assert_allclose(result.opd, parallel.opd, rtol=1e-6)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("rough", [False, True])
def test_a_plane_that_rounding_moves_takes_no_more_steps_than_rounding_is_worth(rough, engine):
    """Planes 2e-9 to 1e-5 rad from parallel, 500 m to 2500 km away, in smooth air and in noise from node to node.

    Formula: deflections are of 1e-6 or 1e-4, so the optical path differs by up to 1e-4 of the way to the plane over the
    slope: 1e12 waves, of which the direction's rounding, 2e-16 over the slope, leaves 1e-8 to 1e-11. Expected: the rays
    that arrive are those of the reference; their errors are below the tolerance, or told and below 1e-5 of the path
    difference. All steps were taken, and rays that are turned away had the status MAX_STEPS.
    """
    noise = 1e-5 * np.random.default_rng(1).normal(size=SMOOTH.shape)
    field = IndexField.from_samples(
        noise if rough else SMOOTH, origin=(-1e-3, -1e-3, 0.0), spacing=(1e-4,) * 3, geometry="volume"
    )
    start = np.random.default_rng(0).uniform(-9e-4, 9e-4, (8, 2))
    rays = RayBundle(np.c_[start, np.full(8, -1e-3)], UP)
    for slope in (1e-5, -1e-6) if rough else (2e-9, 1e-8, 1e-6, 1e-5, -1e-6):
        plane = Plane((0.0 if slope < 0.0 else 5e-3, 0.0, -2e-3), (1.0, 0.0, slope))
        right = trace(field, rays, until=plane, backend="reference")
        found = trace(field, rays, until=plane, method="adaptive", **on(engine))
        assert np.array_equal(found.ok, right.ok)
        assert (found.status[~right.ok] == RayStatus.STOP_NOT_REACHED).all()
        off = np.abs(found.opd - right.opd)[right.ok]
        known = found.status[right.ok] == RayStatus.TOLERANCE_NOT_MET
        assert (off <= np.where(known, found.step_error[right.ok], 1e-3 * 905e-9)).all()
        assert (off <= 1e-3 * 905e-9 + 1e-5 * np.abs(right.opd[right.ok])).all()
        if not rough:
            assert found.step_count.max() < 6000


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_plane_on_a_face_of_the_box(precision, engine):
    """Rounding must not put a ray behind a plane it has just reached: no false failures in 500 rays."""
    backend = on(engine)
    field = uniform_field("volume")
    result = trace(field, oblique_rays(500), until=Plane((0, 0, 4e-3), UP), precision=precision, **backend)
    beside = np.abs(result.position[:, :2]).max(axis=1) > 1.4e-3
    assert result.ok[~beside].all()
    assert np.abs(result.position[~beside, 2] - 4e-3).max() < 1e-15


@pytest.mark.parametrize("engine", ENGINES)
def test_starts_inside_on_a_face_and_at_the_stop(engine):
    """A start on the entry face counts in full, one on the stop not at all, one on the exit face leaves at once."""
    backend = on(engine)
    field = uniform_field("volume")
    outside, on_face = (one((1e-4, 2e-4, z), UP, field, until=Plane((0, 0, 5e-3), UP), **backend) for z in (-1e-3, 0.0))
    assert on_face.opd[0] == pytest.approx(outside.opd[0], rel=1e-9)
    at_stop = one((1e-4, 2e-4, 2e-3), UP, field, until=Plane((0, 0, 2e-3), UP), **backend)
    assert at_stop.ok[0] and at_stop.opd[0] == 0.0 and at_stop.arc_length[0] == 0.0
    leaving = one((1e-4, 2e-4, 4e-3), UP, field, **backend)
    assert leaving.ok[0] and leaving.arc_length[0] == pytest.approx(0.0, abs=1e-12)
    inside = one((1e-4, 2e-4, 1e-3), UP, field, until=ArcLength(0.0), **backend)
    assert inside.ok[0] and inside.optical_path[0] == 0.0


@pytest.mark.parametrize("engine", ENGINES)
def test_splitting_a_ray_adds_up(engine):
    """Tracing to the middle and on from there gives the whole: path, direction and place."""
    backend = on(engine)
    field, rays = uniform_field("volume"), oblique_rays(20)
    settings = {"precision": "float64", "tolerance": 1e-5, **backend}
    whole = trace(field, rays, until=Plane((0, 0, 6e-3), UP), **settings)
    half = trace(field, rays, until=Plane((0, 0, 1.7e-3), UP), **settings)
    rest = trace(field, RayBundle(half.position, half.direction), until=Plane((0, 0, 6e-3), UP), **settings)
    assert np.abs(half.optical_path + rest.optical_path - whole.optical_path).max() < 3e-5 * 905e-9
    assert np.abs(rest.position - whole.position).max() < 1e-9
    assert np.abs(rest.direction - whole.direction).max() < 1e-8


@pytest.mark.parametrize("engine", ENGINES)
def test_light_is_reversible(engine):
    """A ray sent back from its end returns to its start with the same optical path."""
    backend = on(engine)
    field, rays = uniform_field("axisymmetric", amplitude=3e-3), oblique_rays(20)
    settings = {"precision": "float64", "tolerance": 1e-5, **backend}
    out = trace(field, rays, until=Plane((0, 0, 6e-3), UP), **settings)
    back = trace(field, RayBundle(out.position, -out.direction), until=Plane((0, 0, -1e-3), UP), **settings)
    assert np.abs(back.position - rays.position).max() < 1e-9
    assert np.abs(back.direction + rays.direction).max() < 1e-8
    assert np.abs(back.optical_path - out.optical_path).max() < 3e-5 * 905e-9


@pytest.mark.parametrize("engine", ENGINES)
def test_more_steps_than_32_bits_count(engine):
    """max_steps above 2^31 - 1 is legal: no ray takes as many steps, so the result is that of the default."""
    backend, stop = on(engine), Plane((0, 0, 6e-3), UP)
    default = one((0, 0, -1e-3), UP, until=stop, method="adaptive", **backend)
    assert default.opd[0] != 0.0 and default.step_count[0] > 3
    for max_steps in (2**31, 2**32 + 2, 10**12):
        result = one((0, 0, -1e-3), UP, until=stop, method="adaptive", max_steps=max_steps, **backend)
        assert result.status[0] == default.status[0] and result.opd[0] == default.opd[0]


@pytest.mark.parametrize("engine", ENGINES)
def test_rays_along_x_in_a_planar_field(engine):
    """A planar field has no end in x: with a stop the ray gets there, without one it says so."""
    backend = on(engine)
    field = uniform_field("planar")
    result = one((0, 2e-4, 1e-3), (1.0, 0.0, 0.0), field, until=Plane((5e-3, 0, 0), (1, 0, 0)), **backend)
    contrast = field.contrast_at([[0, 2e-4, 1e-3]])[0]
    assert result.ok[0]
    assert result.opd[0] == pytest.approx(contrast * 5e-3, rel=2e-2)
    assert one((0, 2e-4, 1e-3), (1.0, 0.0, 0.0), field, **backend).status[0] == RayStatus.STOP_NOT_REACHED


def test_statuses_say_what_to_do():
    """Every code has a meaning and a remedy."""
    for status in RayStatus:
        assert status.meaning and status.remedy


def ball_field(radius: float = 1e-3) -> IndexField:
    """Contrast 1e-4 everywhere, a ball of the given radius about the origin in it."""
    angle = np.linspace(0.0, np.pi, 181)
    profile = radius * np.stack([np.sin(angle), np.cos(angle)], axis=1)
    profile[[0, -1], 0] = 0.0
    return IndexField.from_samples(
        np.full((61, 121), 1e-4), origin=(0.0, -3e-3), spacing=(5e-5, 5e-5), geometry="axisymmetric", body=Body(profile)
    )


@pytest.mark.parametrize("engine", [*ENGINES, "reference-cpu"])
def test_a_ray_that_starts_in_the_body_begins_at_its_surface(engine):
    """OPD counts from the sphere on, where Snell's law turns the ray; the path counts from the start.

    Expected: T = d + k N on the sphere, (1 + c) times the way to the face at 3 mm, and on to the plane. The wall's
    chords of h = 17 um are inside it by at most h^2 / (8 R) = 0.04 um, where the incidence is greater by 5e-5.
    """
    height = np.array([0.0, 3e-4, 7e-4])
    rays = RayBundle(np.c_[height, 0 * height, 0 * height], [UP])
    result = trace(ball_field(), rays, until=Plane((0, 0, 5e-3), UP), **on(engine))
    surface = np.sqrt(1e-6 - height**2)
    cosine, more = surface / 1e-3, 1e-4 * (2.0 + 1e-4)
    kick = more / (cosine + np.sqrt(cosine**2 + more))
    slope = kick * height / 1e-3 / (1.0 + kick * cosine)
    way = np.sqrt(1.0 + slope**2)
    assert result.ok.all()
    assert np.abs(result.direction[:, 0] - slope / way).max() < 1e-8
    arc = surface + way * (5e-3 - surface)
    assert np.abs(result.opd - (arc - 5e-3) - 1e-4 * way * (3e-3 - surface)).max() < 6e-11
    assert np.abs(result.optical_path - 5e-3 - result.opd).max() < 1e-12
    assert np.abs(result.arc_length - arc).max() < 1e-12


@pytest.mark.parametrize("engine", [*ENGINES, "reference-cpu"])
def test_a_ray_that_meets_the_body_ends_there(engine):
    """It ends on the sphere with a status; one that passes beside does not."""
    height = np.array([0.0, 3e-4, 7e-4, 1.2e-3])
    rays = RayBundle(np.c_[0 * height, height, np.full(4, 4e-3)], [[0.0, 0.0, -1.0]])
    result = trace(ball_field(), rays, until=Plane((0, 0, -4e-3), UP), **on(engine))
    assert list(result.traced_status) == [RayStatus.HIT_BODY] * 3 + [RayStatus.OK]
    allowed = 5e-5 if engine == "reference-cpu" else 5e-6
    assert np.abs(result.position[:3, 2] - np.sqrt(1e-6 - height[:3] ** 2)).max() < allowed


@pytest.mark.parametrize("engine", [*ENGINES, "reference-cpu"])
@pytest.mark.parametrize(("rear", "stop"), [(4e-3, 5e-3), (4e-3, 3.5e-3), (3e-3, 5e-3)])
def test_a_ray_that_never_gets_out_of_the_body(engine, rear, stop):
    """A body that fills the way to the face of the box and beyond it, or ends with it: of either it meets no air.

    A stop beyond the box makes no difference, also within the body.
    """
    backend = on(engine)
    profile = np.array([[0.0, -3e-3], [1e-3, -3e-3], [1e-3, rear], [0.0, rear]])
    field = IndexField.from_samples(
        np.full((61, 121), 1e-4), origin=(0.0, -3e-3), spacing=(5e-5, 5e-5), geometry="axisymmetric", body=Body(profile)
    )
    result = one((1e-4, 0, 0), UP, field, until=Plane((0, 0, stop), UP), **backend)
    assert result.status[0] == RayStatus.INSIDE_BODY
    assert result.opd[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("engine", [*ENGINES, "reference"])
def test_along_x_in_a_planar_body(engine):
    """It has no end in that direction: a ray in it gets to a stop there, and without one never comes out."""
    square = Body([[-2e-3, -2e-3], [2e-3, -2e-3], [2e-3, 2e-3], [-2e-3, 2e-3]], "planar")
    samples = np.full((21, 21), 1e-4)
    field = IndexField.from_samples(
        samples, origin=(-5e-3, -5e-3), spacing=(5e-4, 5e-4), geometry="planar", body=square
    )
    rays = RayBundle([[-1e-3, 0.0, 0.0], [-1e-3, 1e-3, 1e-3]], [1.0, 0.0, 0.0])
    where = {"backend": "reference"} if engine == "reference" else on(engine)
    stopped = trace(field, rays, until=Plane((4e-3, 0.0, 0.0), (1.0, 0.0, 0.0)), **where)
    assert stopped.ok.all()
    np.testing.assert_allclose(stopped.optical_path, 5e-3 * field.ambient_index, rtol=1e-12)
    assert (trace(field, rays, **where).status == RayStatus.INSIDE_BODY).all()


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_ridge_of_a_kinked_field_is_no_trap(engine, precision):
    """Light on the edge of a roof of contrast stays there, kink by kink, and arrives: OPD 0, the roof's on its edge."""
    y = np.arange(-5, 6) * 1e-4
    roof = np.repeat((-20.0 * np.abs(y))[:, None], 11, axis=1)
    field = IndexField.from_samples(
        roof, origin=(-5e-4, 0.0), spacing=(1e-4, 1e-4), geometry="planar", interpolation="linear"
    )
    result = one((0, 0, -1e-3), UP, field, until=Plane((0, 0, 2e-3), UP), precision=precision, **on(engine))
    assert result.ok[0]
    assert abs(result.opd[0]) < 1e-3 * 905e-9
