"""Rays that enter a mesh through a gap in it: their path is that of the cells, whatever the interpolation."""

import numpy as np
import pytest

from aerokernels import IndexField, Plane, QuadMesh, RayBundle, trace
from aerokernels.tracing import RayStatus

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
@pytest.mark.parametrize("interpolation", ["bilinear", "bilinear-barron", "idw"])
def test_a_path_through_gaps_is_that_of_the_cells(engine: str, interpolation: str):
    """Beside the gaps 10 mm of disturbed air, through them 8; also in float32 and along straight lines."""
    backend = {"backend": "reference"} if engine == "reference" else on(engine)
    for geometry in ("planar", "axisymmetric"):
        field = with_gaps(geometry, interpolation)
        across = 0.55 * SIDE if geometry == "axisymmetric" else 0.05 * SIDE
        rays = RayBundle(np.array([[0.0, across, -SIDE], [0.0, across + 0.1 * SIDE, -SIDE]]), [[0.0, 0.0, 1.0]] * 2)
        for method, precision in (("adaptive", "float64"), ("adaptive", "float32"), ("straight", "float64")):
            options = {"until": Plane((0.0, 0.0, 2.0 * SIDE), (0.0, 0.0, 1.0)), "wavelength": 1e-6, "tolerance": 1e-3}
            if engine == "reference" and precision == "float32":
                continue
            found = trace(field, rays, method=method, precision=precision, **options, **backend)
            assert (found.status == RayStatus.LEFT_DISTURBED_AIR).all()
            np.testing.assert_allclose(found.opd, CONTRAST * SIDE * np.array([0.8, 1.0]), atol=1.5e-9)
