"""Where bundles end: rays that miss, graze or leave the field's support, and stops far off or met at a slant.

The truth is the same rays under error control in float64 at a thousandth of the tolerance; straight rays are exact.
"""

import functools
import warnings

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.rays import Disc, RayBundle
from aerokernels.tracing import Plane, RayStatus, trace
from aerokernels.tracing.launch import ToleranceWarning
from aerokernels.tracing.leapfrog.pilot import LEAST_RAYS
from aerokernels.tracing.lines import lever_arms_of
from aerokernels.tracing.plan import TracePlan
from aerokernels.tracing.pupil.run import PupilRun
from aerokernels.tracing.tasks.sums import PupilTask
from tests.random_fields import uniform_field
from tests.slow import first_of

from ..backends import ENGINES, WAVE, on

COUNT = LEAST_RAYS + 37
TOLERANCE = 1e-3
SOME = np.arange(0, COUNT, 9)  # rays that are compared
GRAZED = Plane((0.0, 0.0, 1.0), (0.0, 1.0, 1e-5))


def blob(geometry: str, at=(0.0, 0.0), contrast: float = -2e-4, size: float = 4e-3, cells: int = 61) -> IndexField:
    """A Gaussian at (across, along), elsewhere nothing, in a box of 30 mm about the origin."""
    across = np.linspace(0.0 if geometry == "axisymmetric" else -30e-3, 30e-3, cells)
    along = np.linspace(-30e-3, 30e-3, cells)
    r, z = np.meshgrid(across, along, indexing="ij")
    samples = contrast * np.exp(-(((r - at[0]) ** 2 + (z - at[1]) ** 2) / size**2))
    origin = (across[0], along[0])
    spacing = (across[1] - across[0], along[1] - along[0])
    if geometry == "volume":
        samples = samples[None] * np.exp(-((across / size) ** 2))[:, None, None]
        origin, spacing = (across[0], *origin), (spacing[0], *spacing)
    return IndexField.from_samples(samples, origin=origin, spacing=spacing, geometry=geometry)


def every_way(geometry: str, inside: bool, seed: int) -> RayBundle:
    """Rays of every direction through random places of the box, from there or from outside of it."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(COUNT, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    if geometry == "planar":
        direction[:, 0] *= 0.1
    place = rng.uniform(-25e-3, 25e-3, (COUNT, 3)) * (0.7 if geometry == "axisymmetric" else 1.0)
    return RayBundle(place if inside else place - 0.12 * direction, direction)


def truth(field: IndexField, rays: RayBundle, until, tolerance: float = TOLERANCE):
    """Under error control, of some rays."""
    options = {"method": "adaptive", "precision": "float64", "tolerance": 1e-3 * tolerance}
    return trace(field, rays.rows(SOME), until=until, **options, **on("opencl-cpu"))


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("geometry", first_of(["volume", "axisymmetric", "planar"]))
def test_rays_of_every_direction_end_where_they_should(engine, geometry):
    """Out of the box by every face at every slant, most of them without meeting the blob in one corner of it.

    Place and arc length within 1 um and what an OPD of the tolerance is at a stop met at 3 degrees (1 / 0.05).
    """
    field = blob(geometry, at=(8e-3, -12e-3), contrast=-5e-5)
    for inside in (True, False):
        rays = every_way(geometry, inside, 4)
        exact = truth(field, rays, None)
        found = trace(field, rays, **on(engine), precision="float64")
        assert found.plan.sample_count > 0
        assert (found.status[SOME] == exact.status).all() and exact.ok.mean() > 0.9
        ok = exact.ok
        assert np.abs(found.opd[SOME] - exact.opd)[ok].max() < TOLERANCE * WAVE
        assert np.linalg.norm(found.position[SOME] - exact.position, axis=1)[ok].max() < 1e-6 + 20.0 * TOLERANCE * WAVE
        assert np.abs(found.arc_length[SOME] - exact.arc_length)[ok].max() < 1e-6 + 20.0 * TOLERANCE * WAVE
        assert np.abs(found.optical_path[SOME] - exact.optical_path)[ok].max() < 1e-6 + 20.0 * TOLERANCE * WAVE


@pytest.mark.parametrize("engine", ENGINES)
def test_rays_that_leave_by_the_cylinder_at_a_slant(engine):
    """Through a blob on the axis and then through undisturbed air: one Newton step to the cylinder was 0.1 wave off."""
    field = blob("axisymmetric")
    rng = np.random.default_rng(0)
    start = np.c_[rng.uniform(-5e-3, 5e-3, COUNT), np.full(COUNT, -20e-3), rng.uniform(-3e-3, 3e-3, COUNT) - 14e-3]
    rays = RayBundle(start, (0.0, 1.0, 0.7))
    for until in (None, Plane((0.0, 60e-3, 0.0), (0.0, 1.0, 0.0)), Plane((0.0, 15e-3, 0.0), (0.0, 1.0, -0.3))):
        exact = truth(field, rays, until)
        found = trace(field, rays, until=until, **on(engine), precision="float64")
        assert found.plan.sample_count > 0 and found.ok.all()
        assert np.abs(found.opd[SOME] - exact.opd).max() < TOLERANCE * WAVE
        assert np.abs(found.position[SOME] - exact.position).max() < 1e-7


@functools.cache
def along_the_span():
    """A metre of the tail of a layer, its rays and stop, and where single rays end."""
    y, z = np.arange(81) * 0.1e-3, np.arange(81) * 0.1e-3
    samples = np.repeat(2e-5 * np.exp(-y / 0.7e-3)[:, None], len(z), axis=1)
    field = IndexField.from_samples(samples, origin=(0.0, 0.0), spacing=(0.1e-3, 0.1e-3), geometry="planar")
    rng = np.random.default_rng(0)
    rays = RayBundle(
        np.c_[np.zeros(COUNT), rng.uniform(4e-3, 7.5e-3, COUNT), rng.uniform(1e-3, 7e-3, COUNT)],
        np.c_[np.ones(COUNT), 3e-4 * rng.standard_normal((COUNT, 2))],
    )
    until = Plane((2.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    return field, rays, until, truth(field, rays, until)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_planar_field_seen_along_its_span(engine):
    """What is left out counts by the whole way, and no ray runs out of steps."""
    backend = on(engine)
    field, rays, until, exact = along_the_span()
    lever_arms = lever_arms_of(field, rays, until)
    assert lever_arms is not None and abs(lever_arms.path_length - 2.0) < 1e-3
    found = trace(field, rays, until=until, **backend, precision="float64")
    assert (found.traced_status[SOME] == exact.traced_status).all() and found.ok.all()
    assert np.abs(found.opd[SOME] - exact.opd).max() < TOLERANCE * WAVE


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_far_plane_at_45_degrees(engine, precision):
    """At 100 m an error of direction of 1e-11 rad is the tolerance: both methods know, and so does float32.

    A boundary layer exp(-y / 1 mm), whose tail is never uniform, and rays that also start above it.
    """
    y = np.arange(61) * 0.4e-3
    samples = np.repeat(3e-4 * np.exp(-y / 1e-3)[:, None], 81, axis=1)
    field = IndexField.from_samples(samples, origin=(0.0, 0.0), spacing=(0.4e-3, 0.4e-3), geometry="planar")
    rng = np.random.default_rng(0)
    rays = RayBundle(np.c_[np.zeros(COUNT), rng.uniform(1e-3, 22e-3, COUNT), np.full(COUNT, -5e-3)], (0.0, 0.02, 1.0))
    for distance in (10.0, 100.0):
        until = Plane((0.0, 0.0, distance), (0.0, 1.0, 1.0))
        exact = truth(field, rays, until)
        for method in ("auto", "adaptive"):
            found = trace(field, rays, until=until, method=method, precision=precision, **on(engine))
            held = found.traced_status[SOME] == RayStatus.OK
            assert held.mean() > 0.99
            assert np.abs(found.opd[SOME] - exact.opd)[held].max() < TOLERANCE * WAVE, (distance, method)


@pytest.mark.parametrize("engine", ENGINES)
def test_rays_above_the_tolerance_are_told_of(engine):
    """To a plane met at 1e-5 rad a direction's error counts 1e5 times: no steps hold 1e-8 wave.

    Status, plan and a warning say so.
    """
    field = uniform_field("planar", amplitude=3e-6)
    aim = np.linspace(-5e-7, 5e-8, 50)
    rays = RayBundle(np.c_[0 * aim, aim, 0 * aim - 1e-3], (0.0, 0.0, 1.0))
    until, tolerance = GRAZED, 1e-8
    with pytest.warns(ToleranceWarning, match="rays have error estimates above the tolerance"):
        found = trace(field, rays, until=until, tolerance=tolerance, **on(engine))
    count = found.status_summary()["TOLERANCE_NOT_MET"]
    assert count > 40 and found.ok.all()
    assert any(reason.startswith(f"{count} of 50 rays") for reason in found.plan.reasons)
    with pytest.warns(ToleranceWarning):
        part = trace(field, rays, until=until, outputs=("opd",), tolerance=tolerance, **on(engine))
    assert part.step_error is None and (part.status == found.status).all()
    # The caller's own steps: no claim, no retrace.
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fixed = trace(field, rays, until=until, method="fixed", step=1e-4, **on(engine))
    assert fixed.ok.all() and not (fixed.status == RayStatus.TOLERANCE_NOT_MET).any()


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
def test_a_pupil_counts_rays_above_the_tolerance(engine):
    """Those to the same plane: 320 in the sums, counted as above the tolerance."""
    field = uniform_field("planar", amplitude=3e-6)
    pupil = Disc(5e-8, center=(0.0, 0.0, -1e-3))
    here = on(engine)
    plan = TracePlan("adaptive", **here, precision="float64", max_steps=10_000, step=None, tolerance=1e-6)
    for until, rejected in ((Plane((0.0, 0.0, 1.0), (0.0, 1.0, 1.0)), 0), (GRAZED, 320)):
        sums = PupilRun(PupilTask(field, pupil, pupil.normal, until, plan, WAVE, 20, 16))(3)
        assert abs(sums.moments[:, 0].sum() - 320.0) < 1e-9 and sums.rejected_count == rejected
        assert (sums.greatest_error > 1e-6 * WAVE) == (rejected > 0)
