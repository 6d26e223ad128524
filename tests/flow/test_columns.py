"""Line integrals of the density, exactly as the cells of a mesh hold it."""

import numpy as np
import pytest

from aerokernels import flow
from aerokernels.medium import QuadMesh


def skewed(geometry: str) -> flow.CellDensity:
    """Random averages on 14 x 11 cells that are no rectangles, r or y from 0 to 1, z from -1 to 1."""
    random = np.random.default_rng(2)
    u, v = np.meshgrid(np.linspace(0.0, 1.0, 15), np.linspace(-1.0, 1.0, 12), indexing="ij")
    inner = np.zeros_like(u)
    inner[1:-1, 1:-1] = 1.0
    mesh = QuadMesh.structured(
        u + 0.012 * inner * random.uniform(-1, 1, u.shape), v + 0.03 * inner * random.uniform(-1, 1, v.shape), geometry
    )
    return flow.CellDensity(mesh, random.uniform(1.0, 2.0, len(mesh.cells)), 1.1)


def test_columns_through_rings_and_rows_are_exact():
    """Set-up: rings 0.1 wide, layers 0.2 thick, each with a density of its own. Expected: chords of circles, 1e-13."""
    r, z = np.meshgrid(np.linspace(0.0, 1.0, 11), np.linspace(0.0, 1.0, 6), indexing="ij")
    density = np.random.default_rng(4).uniform(1.0, 2.0, (10, 5))
    field = flow.CellDensity(QuadMesh.structured(r, z, "axisymmetric"), density, 1.0)
    along = field.columns([[0.03, 0.04, 0.5], [0.0, -0.77, 0.0]], [0.0, 0.0, -1.0])
    assert along == pytest.approx(0.2 * (density[[0, 7]] - 1.0).sum(axis=1), rel=1e-13)
    again = field.scaled(3.0).columns([[0.03, 0.04, 0.5], [0.0, -0.77, 0.0]], [0.0, 0.0, -1.0])
    assert again == pytest.approx(3.0 * along, rel=1e-13)  # other values along lines whose pieces the mesh has kept
    half = np.sqrt(np.maximum(np.linspace(0.0, 1.0, 11) ** 2 - 0.25**2, 0.0))
    across = field.columns([5.0, 0.25, 0.5], [-1.0, 0.0, 0.0])
    assert across == pytest.approx([2.0 * np.diff(half) @ (density[:, 2] - 1.0)], rel=1e-13)


def test_lines_that_are_none_are_refused():
    with pytest.raises(ValueError, match="the points of lines must be finite"):
        flow.wedge(3.0, 0.2, spacing=5e-3).columns([0.0, np.nan, 0.0], [0.0, 0.0, 1.0])
    with pytest.raises(ValueError, match="unit vectors"):
        skewed("planar").columns([0.0, 0.0, 0.0], [0.0, 0.0, 2.0])
    with pytest.raises(ValueError, match="never leave"):
        skewed("planar").columns([0.0, 0.5, 0.0], [1.0, 0.0, 0.0])
