"""Rays that enter a mesh through a gap in it: their path is that of the cells, whatever the interpolation."""

import numpy as np
import pytest

from aerokernels import Disc, IndexField, Plane, QuadMesh, RayBundle, estimate_strehl, trace, wavefront
from aerokernels.medium.grid import UniformGrid
from aerokernels.tracing import RayStatus
from tests.slow import first_of

from .backends import ENGINES, on

CONTRAST, SIDE = 1e-4, 10e-3


def with_gaps(geometry: str, interpolation: str) -> IndexField:
    """A square of 10 x 10 cells of the same contrast, of a column without the first cell and one in the middle."""
    first = 0.0 if geometry == "axisymmetric" else -0.5 * SIDE
    a, b = np.meshgrid(np.linspace(first, first + SIDE, 11), np.linspace(0.0, SIDE, 11), indexing="ij")
    whole = QuadMesh.structured(a, b, geometry)
    middle = whole.corners.mean(axis=1)
    column = np.abs(middle[:, 0] - (first + 0.55 * SIDE)) < 1e-6
    gone = column & ((middle[:, 1] < 0.1 * SIDE) | (np.abs(middle[:, 1] - 0.55 * SIDE) < 1e-6))
    mesh = QuadMesh(whole.vertices, whole.cells[~gone], geometry)
    return IndexField.from_mesh(mesh, np.full(len(mesh.vertices), CONTRAST), interpolation=interpolation)


@pytest.mark.parametrize("engine", [*ENGINES, "reference"])
@pytest.mark.parametrize("interpolation", first_of(["bilinear", "bilinear-barron", "idw"]))
def test_a_path_through_gaps_is_that_of_the_cells(engine: str, interpolation: str):
    """Beside the gaps 10 mm of disturbed air, through them 8; in both precisions and along straight lines."""
    backend = {"backend": "reference"} if engine == "reference" else on(engine)
    for geometry, method, precision in (
        ("planar", "adaptive", "float32"),
        ("axisymmetric", "adaptive", "float64"),
        ("planar", "straight", "float64"),
    ):
        field = with_gaps(geometry, interpolation)
        across = 0.55 * SIDE if geometry == "axisymmetric" else 0.05 * SIDE
        rays = RayBundle(np.array([[0.0, across, -SIDE], [0.0, across + 0.1 * SIDE, -SIDE]]), [[0.0, 0.0, 1.0]] * 2)
        options = {"until": Plane((0.0, 0.0, 2.0 * SIDE), (0.0, 0.0, 1.0)), "wavelength": 1e-6, "tolerance": 1e-3}
        found = trace(field, rays, method=method, precision=precision, **options, **backend)
        assert (found.status == RayStatus.OK).all()
        np.testing.assert_allclose(found.opd, CONTRAST * SIDE * np.array([0.8, 1.0]), atol=1.5e-9)


def ring(inner: float) -> tuple[IndexField, float]:
    """A mesh that begins at a radius `inner`, whose contrast falls with z alone, and its path along z at any radius.

    The interpolant is linear between nodes, so that the trapezoidal rule gives the path exactly.
    """
    r, z = np.linspace(inner, inner + 16e-3, 17), np.linspace(-16e-3, 16e-3, 65)
    along = 2e-5 * np.cos(0.5 * np.pi * z / z[-1]) ** 2
    mesh = QuadMesh.structured(*np.meshgrid(r, z, indexing="ij"), "axisymmetric")
    return IndexField.from_mesh(mesh, np.tile(along, (17, 1))), float(np.trapezoid(along, z))


@pytest.mark.parametrize("engine", [*ENGINES, "reference"])
def test_a_hole_about_the_axis_is_ambient(engine: str):
    """Set-up: rays along the axis and across it, through a mesh that begins at r = 4 mm, and through a grid of it.

    Expected: along the axis no path in the hole, and that of the mesh beyond it; across the axis, in the middle, twice
    the mesh's width. Tolerance: 1e-3 wave as asked for; on the grid 12 mm from the jump at the hole, 2e-4 of the path.
    """
    backend = {"backend": "reference"} if engine == "reference" else on(engine)
    field, path = ring(4e-3)
    start = np.array([[0.0, 0.0], [2e-3, 1e-3], [3.99e-3, 0.0], [5e-3, 0.0], [0.0, 16e-3]])
    rays = RayBundle(np.c_[start, np.full(5, -0.03)], [[0.0, 0.0, 1.0]] * 5)
    options = {"until": Plane((0.0, 0.0, 0.03), (0.0, 0.0, 1.0)), "wavelength": 1e-6, "tolerance": 1e-3}
    found = trace(field, rays, **options, **backend)
    assert found.ok.all()
    np.testing.assert_allclose(found.opd, [0.0, 0.0, 0.0, path, path], atol=1e-9)
    aside = RayBundle(np.array([[-0.03, 0.0, 0.0]]), [[1.0, 0.0, 0.0]])
    through = trace(field, aside, wavelength=1e-6, until=Plane((0.03, 0.0, 0.0), (1.0, 0.0, 0.0)), **backend)
    np.testing.assert_allclose(through.opd, 2.0 * 16e-3 * 2e-5, atol=1e-9)
    grid = field.resample(spacing=2.5e-4)
    assert grid.samples.origin[0] == 0.0
    np.testing.assert_allclose(trace(grid, rays, **options, **backend).opd[[0, 4]], [0.0, path], atol=2e-4 * path)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_pupil_before_a_ring_of_air(engine: str):
    """Set-up: a disc of 6 mm before the ring above, a little aside: four ninths of its light go through the hole.

    Expected: |a + (1 - a) exp(i k path)|^2, on the mesh and on a grid of it, each within three times its own error.
    """
    field, path = ring(4e-3)
    pupil, hole = Disc(6e-3, (6e-4, 9e-4, -0.03)), (4.0 / 6.0) ** 2
    true = 1.0 - 2.0 * hole * (1.0 - hole) * (1.0 - np.cos(2.0 * np.pi * path / 905e-9))
    for seen in (field, field.resample(spacing=2.5e-4)):
        for door in (
            estimate_strehl(seen, pupil, wavelength=905e-9, ray_count=4096, **on(engine)).quantities["value"],
            wavefront(seen, pupil, wavelength=905e-9, pixel_count=48, **on(engine)).quantities["strehl"],
        ):
            assert abs(door.value - true) <= 3.0 * door.error
    assert true < 0.95


def test_a_grid_that_begins_off_the_axis_is_no_field():
    """However it was made: its samples would be taken for those at r = 0."""
    grid = UniformGrid(np.zeros((5, 5)), np.array([1e-3, 0.0]), np.array([1e-3, 1e-3]), "cubic", True, 1.0)
    with pytest.raises(ValueError, match=r"an axisymmetric grid starts at r = 0, got origin 0\.001 m"):
        IndexField(grid, "axisymmetric", 1.0)
