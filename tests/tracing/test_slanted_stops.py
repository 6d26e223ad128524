"""Stops met at a slant: there errors of place and direction are errors of the path, the more so the further off."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from aerokernels.device_arrays import on_host
from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, trace
from aerokernels.tracing.launch import run_plan
from aerokernels.tracing.plan import TracePlan
from tests.random_fields import CELL, uniform_field

from .backends import ENGINES, WAVE, on


def right(field: IndexField, rays: RayBundle, until):
    """The same rays in float64, by steps of a twentieth of a cell."""
    return trace(field, rays, until=until, method="fixed", step=CELL / 20, precision="float64")


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("geometry", ["volume", "axisymmetric"])
def test_a_far_slanted_plane_is_within_the_tolerance(engine, geometry):
    """Where direction errors that a plane across the rays forgives would be many times the tolerance."""
    field = uniform_field(geometry, amplitude=1e-4)
    rng = np.random.default_rng(11)
    position = np.c_[rng.uniform(-5e-4, 5e-4, (60, 2)), np.full(60, -1e-3)]
    rays = RayBundle(position, np.c_[rng.normal(0.0, 0.1, (60, 2)), np.ones(60)])
    for normal in ((0.0, 0.0, 1.0), (0.5, 0.0, 1.0)):
        plane = Plane((0.0, 0.0, 0.2), normal)
        expected = right(field, rays, plane)
        for precision in ("float32", "float64"):
            result = trace(
                field, rays, until=plane, method="adaptive", precision=precision, tolerance=1e-3, **on(engine)
            )
            assert (result.traced_status == expected.traced_status).all()
            assert np.abs(result.opd - expected.opd)[expected.ok].max() < 1.5e-3 * WAVE, (normal, precision)


@pytest.mark.parametrize("engine", ENGINES)
def test_rays_that_just_miss_an_edge_of_the_box(engine):
    """In air that gets denser towards -y, rays that leave by that side a little before it, or by the end.

    A ten-thousandth of a cell beside the edge is a hundred times as far along the ray.
    """
    y = CELL * (np.arange(17) - 8)
    contrast = np.repeat((1e-4 - 0.02 * y)[:, None], 41, axis=1)
    field = IndexField.from_samples(contrast, origin=(y[0], 0.0), spacing=(CELL, CELL), geometry="planar")
    count, slope, end = 2000, -0.006, 40 * CELL
    # A slope of 0.02 / m bends a ray down by some 1.6e-7 m, sixteen times what may count as being on the edge.
    aim = y[0] - slope * end
    start = aim + np.linspace(-4e-3, 4e-3, count) * CELL
    rays = RayBundle(np.c_[np.zeros(count), start, np.zeros(count)], (0.0, slope, 1.0))
    plan = TracePlan("leapfrog", **on(engine), precision="float32", max_steps=100_000, step=None, tolerance=1e-3)
    plan = replace(plan, sample_count=36, quadrature_error_scale=0.125, trajectory_error_scale=0.01)
    arrays = on_host(run_plan(field, rays, plan, None, WAVE, frozenset(("opd", "evaluation_count"))))
    assert 0.1 < (arrays["evaluation_count"] == 36).mean() < 1.0
    expected = right(field, rays, None)
    leaves_by_end = expected.position[:, 2] > end * (1.0 - 1e-12)
    assert 0.1 < leaves_by_end.mean() < 0.9
    assert np.abs(arrays["opd"] - expected.opd).max() < 1e-3 * WAVE


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_float32_lands_on_surfaces_that_it_grazes(engine, geometry):
    """On a plane and on a side of the box, at 1 to 3 degrees: rounding of the place is many times as much path."""
    field = uniform_field(geometry, amplitude=1e-5)
    side = field.box[1][1]
    slope = np.linspace(0.02, 0.06, 40)
    below = slope * np.linspace(1.7e-3, 3.9e-3, 40)  # at z = 0, to be there before the end of the box at 4 mm
    for height, until in ((side, None), (6.3e-4, Plane((0.0, 6.3e-4, 0.0), (0.0, 1.0, 0.0)))):
        rays = RayBundle(np.c_[0 * slope, height - below, 0 * slope], np.c_[0 * slope, slope, np.ones(40)])
        exact = trace(field, rays, until=until, method="adaptive", tolerance=1e-6, precision="float64", **on(engine))
        result = trace(field, rays, until=until, method="adaptive", tolerance=1e-4, precision="float32", **on(engine))
        assert exact.ok.all() and result.ok.all()
        assert np.abs(result.opd - exact.opd).max() < 2e-4 * WAVE
        assert np.abs(result.position[:, 1] - height).max() < 1e-15


@pytest.mark.parametrize("engine", ENGINES)
def test_auto_holds_the_tolerance_on_a_far_slanted_plane(engine):
    """A step short enough for the paths in the field would leave directions too much in error: error control holds."""
    noise = gaussian_filter(np.random.default_rng(8).standard_normal((96, 192)), 6.0, mode="wrap")
    contrast = 1e-5 * noise / np.abs(noise).max()
    field = IndexField.from_samples(contrast, origin=(-48 * CELL, 0.0), spacing=(CELL, CELL), geometry="planar")
    aim = np.linspace(-30, 30, 60) * CELL
    rays = RayBundle(np.c_[0 * aim, aim, 0 * aim], (0.0, 0.01, 1.0))
    chosen = {}
    for name, normal in (("across", (0.0, 0.01, 1.0)), ("slanted", (0.0, 2.0, 1.0))):
        plane = Plane((0.0, 0.0, 3.0), normal)
        chosen[name] = trace(field, rays, until=plane, tolerance=1e-3, precision="float64", **on(engine))
        exact = trace(field, rays, until=plane, method="adaptive", tolerance=1e-6, precision="float64", **on(engine))
        assert np.abs(chosen[name].opd - exact.opd).max() < 1e-3 * WAVE, name
        assert chosen[name].plan.method == "adaptive"
