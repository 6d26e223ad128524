"""Rays through the corners of cells: they go on, and leave the mesh at a corner."""

import numpy as np
import pytest

from aerokernels import IndexField, QuadMesh, RayBundle, trace
from aerokernels.tracing import RayStatus


@pytest.mark.parametrize("seed", range(3))
def test_a_ray_leaves_a_mesh_at_a_corner(seed: int):
    """Set-up: slanted rows of cells, rays to the corners at the end. Expected: the paths of rays 1e-9 m beside them.

    Such a ray went to and fro between the two cells of a corner until it had taken all of its steps.
    """
    draw = np.random.default_rng(seed)
    along, across = np.meshgrid(np.linspace(0.0, 1.0, 9), np.linspace(0.0, 1.0, 6))
    low = draw.uniform(0.2, 0.9) * (1.0 - along)
    mesh = QuadMesh.structured(low + (1.2 - low) * across, along - 1.0, "planar")
    field = IndexField.from_mesh(mesh, 1e-5 * draw.random(40), interpolation="bilinear")
    ends = 1.2 * np.linspace(0.0, 1.0, 6)[1:-1]
    options = {"wavelength": 905e-9, "backend": "reference", "max_steps": 200}

    def traced(height):
        start = np.stack([0.0 * height, height, 0.0 * height - 0.45], axis=1)
        return trace(field, RayBundle(start, np.tile([0.0, 0.0, 1.0], (len(height), 1))), **options)

    found, beside = traced(ends), traced(ends + 1e-9)
    assert RayStatus.MAX_STEPS not in found.status
    np.testing.assert_allclose(found.opd, beside.opd, rtol=1e-6)
