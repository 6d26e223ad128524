"""The budget of a field that was resampled, or lies on a mesh: along the bundle's own lines, to the bundle's own stop.

Set-up: a plane layer n = 1 + A (1 + tanh(d / T)) / 2 at an angle to the rays, on a mesh of 1 mm cells. Truth: rays
through the formula itself, as straight lines with the deflection that they gather (both of first order in A = 2e-5),
by the midpoint rule: OPD at a plane whose normal N makes an angle with the ray = integral of m + what the deflection
theta changes in the length of the way L from the layer to the plane, L theta tan(angle) to first order. Error sources:
second order in theta, 1e-5 of the first.
"""

from dataclasses import replace

import numpy as np
import pytest

from aerokernels import IndexField, QuadMesh, trace
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane
from tests.slow import first_of

WAVE = 905e-9
JUMP, THICK, ANGLE = 2e-5, 1.5e-3, np.radians(60.0)
SIZE = 40e-3
STOPS = {"across": Plane((0, 0, SIZE), (0, 0, 1)), "aslant and far": Plane((0, 0, 1.5), (0, 1, 1))}


def layer(y, z):
    """Contrast and its slope along y."""
    place = ((z - 0.5 * SIZE) * np.sin(ANGLE) - y * np.cos(ANGLE)) / THICK
    return JUMP * 0.5 * (1.0 + np.tanh(place)), -JUMP * 0.5 * np.cos(ANGLE) / THICK / np.cosh(place) ** 2


def field_on_mesh(structured: bool, count: int = 41) -> IndexField:
    """The layer on a wavy mesh, 1 mm cells."""
    y, z = np.meshgrid(np.linspace(-0.5 * SIZE, 0.5 * SIZE, count), np.linspace(0.0, SIZE, count), indexing="ij")
    y = y + 0.25e-3 * np.sin(700.0 * z) * (np.abs(y) < 0.49 * SIZE)
    mesh = QuadMesh.structured(y, z)
    if not structured:
        mesh = QuadMesh(mesh.vertices, mesh.cells, "planar")
    return IndexField.from_mesh(mesh, layer(y, z)[0].ravel())


def bundle(count: int = 60) -> RayBundle:
    """Rays along z from the first face of the box."""
    height = np.linspace(-8e-3, 8e-3, count)
    return RayBundle(np.c_[0.0 * height, height, 0.0 * height], [0.0, 0.0, 1.0])


def exact(rays: RayBundle, until: Plane) -> np.ndarray:
    """OPD [m] by the formula of this page."""
    z = (np.arange(20_000) + 0.5) / 20_000 * SIZE
    contrast, slope = layer(rays.position[:, 1:2], z)
    tangent = until.normal[1] / until.normal[2]
    way = ((until.point - rays.position) @ until.normal) / until.normal[2]
    gathered = slope * (way[:, None] - z)  # a deflection at z moves the ray at the stop by theta (way - z)
    return (contrast - tangent * gathered).mean(axis=1) * SIZE


@pytest.mark.parametrize("stop", STOPS)
@pytest.mark.parametrize("spacing", [None, 1e-3, 0.3e-3])
@pytest.mark.parametrize("structured", [True, False], ids=["structured", "unstructured"])
def test_the_total_covers_the_error(structured, spacing, stop):
    """Known causes but the end of the air, which the formula shares: not below the error, nor a thousand times it."""
    field = field_on_mesh(structured)
    field = field if spacing is None else field.resample(spacing)
    rays, until = bundle(), STOPS[stop]
    result = trace(field, rays, until=until, precision="float64")
    error = np.abs(result.opd - exact(rays, until)).max()
    reported = np.sqrt(sum(result.error[cause] ** 2 for cause in ("step", "interpolation", "resampling", "precision")))
    assert result.ok.all() and error < reported < max(300.0 * error, 0.1 * WAVE)
    assert result.error["interpolation"] > 0.0 and result.error["total"] >= reported
    assert (result.error["resampling"] > 0.0) == (spacing is not None)


def test_an_unstructured_mesh_has_an_interpolation_error_unless_it_is_linear():
    """It was exactly 0 for any field; of a linear field it is rounding, of a curved one of the size of the error."""
    y, z = np.meshgrid(np.linspace(-1e-2, 1e-2, 11), np.linspace(0.0, 2e-2, 11), indexing="ij")
    flat = QuadMesh.structured(y, z)
    mesh = QuadMesh(flat.vertices, flat.cells, "planar")
    rays, until = (
        RayBundle(np.c_[[[0.0]] * 9, np.linspace(-7e-3, 7e-3, 9), np.zeros(9)], [0, 0, 1.0]),
        Plane((0, 0, 2e-2), (0, 0, 1)),
    )
    straight = trace(IndexField.from_mesh(mesh, 1e-3 * y.ravel()), rays, until=until, precision="float64")
    assert straight.error["interpolation"] < 1e-6 * WAVE
    curved = IndexField.from_mesh(mesh, 1e-1 * y.ravel() ** 2)
    result = trace(curved, rays, until=until, precision="float64")
    # The chord of a parabola: the greatest error is 0.1 h^2 / 4 over 20 mm.
    error = 0.1 * (2e-3) ** 2 / 4.0 * 2e-2
    assert error < result.error["interpolation"] < 10.0 * error


@pytest.mark.parametrize("geometry", first_of(["planar", "axisymmetric"]))
def test_without_a_stop_both_fields_are_compared_on_the_faces(geometry):
    """Rays out of the side and of the end of a region, cut from a larger field: the resampling error of a coarse grid.

    Truth: the same rays through the source to the plane z = 6 mm, which some of them reach first.
    """
    y, z = np.meshgrid(np.linspace(0.0, 8e-3, 81), np.linspace(0.0, 8e-3, 81), indexing="ij")
    mesh = QuadMesh.structured(y, z, geometry)
    source = IndexField.from_mesh(mesh, 1e-4 * np.exp(-((y - 2e-3) ** 2 + (z - 3e-3) ** 2) / 1e-3**2))
    grid = source.resample(0.6e-3, region=((0.0, 0.0), (6e-3, 6e-3)))
    low = 1e-3
    rays = RayBundle(
        np.c_[np.zeros(30), np.linspace(low, 3e-3, 30), np.full(30, 1e-3)],
        np.c_[np.zeros(30), np.tile([0.0, 0.2, 1.5], 10), np.ones(30)],
    )
    result = trace(grid, rays, precision="float64")
    through = trace(source, rays, until=Plane((0, 0, 6e-3), (0, 0, 1)), precision="float64")
    ahead = rays.direction[:, 1] < 0.5
    apart = float(np.sqrt(np.mean((result.opd - through.opd)[ahead] ** 2)))
    assert 0.5 * apart < result.error["resampling"] < 20.0 * apart
    assert np.isfinite(result.error["total"])


def test_a_source_that_is_not_kept_leaves_the_budget_unknown():
    """And one that was resampled twice is compared with the first."""
    field, rays, until = field_on_mesh(True), bundle(12), STOPS["across"]
    grid = field.resample(0.5e-3)
    lost = replace(grid, resampling=replace(grid.resampling, source=None))
    error = trace(lost, rays, until=until).error
    assert np.isnan([error["resampling"], error["total"]]).all()
    twice = grid.resample(2e-3)
    once = trace(field.resample(2e-3), rays, until=until)
    again = trace(twice, rays, until=until)
    assert again.error["resampling"] == pytest.approx(once.error["resampling"], rel=0.5)
    assert again.error["interpolation"] == pytest.approx(once.error["interpolation"], rel=1e-6)
