"""Rays of the reference engine that cross gaps between a skewed mesh and its box.

Set-up: cells of a sheared, bent mesh of 1.6 mm x 1 mm, so that rays fly through gaps before, behind and beside it; the
contrast bends them by some 1e-3 rad. Expected: an end on the plane; from there the way back ends where the ray began;
after a stop by length of arc, that length. Error: rounding, below 1e-12 m. A displacement of the wrong sign in a gap
would be 1e-7 m.
"""

import numpy as np
import pytest

from aerokernels import ArcLength, IndexField, Plane, QuadMesh, RayBundle, trace

OPTIONS = {"backend": "reference", "precision": "float64", "tolerance": 0.3}


def bent_field(geometry: str) -> IndexField:
    u, v = np.meshgrid(np.linspace(0.0, 1.0, 9), np.linspace(0.0, 1.0, 9), indexing="ij")
    mesh = QuadMesh.structured(1e-3 * (0.2 + u + 0.3 * v + 0.1 * u * v), 1e-3 * (v + 0.2 * np.sin(3.0 * u)), geometry)
    y, z = 1e3 * mesh.vertices.T
    return IndexField.from_mesh(mesh, 1e-3 * (y + 0.3 * np.sin(3.0 * z)), ambient_index=1.0002)


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
@pytest.mark.parametrize("stop", [1.05e-3, 3e-3, "arc"])
def test_rays_end_on_their_stop(geometry: str, stop):
    y = 1e-3 * np.array([0.3, 0.8, 1.4])
    rays = RayBundle(np.c_[np.full(3, 1e-5), y, np.full(3, -0.2e-3)], np.array([[0.02, 0.2, 1.0]]))
    point, normal = (
        np.array([0.0, 0.0, stop if stop != "arc" else 1e-3]),
        np.array([0.0, 0.4, 1.0]) / np.hypot(0.4, 1.0),
    )
    until = ArcLength(1.7e-3) if stop == "arc" else Plane(point, normal)
    found = trace(bent_field(geometry), rays, until=until, **OPTIONS)
    assert found.ok.all()
    turned = np.linalg.norm(np.cross(found.direction, rays.direction), axis=1)
    assert turned.max() > 1e-4
    if stop == "arc":
        np.testing.assert_allclose(found.arc_length, 1.7e-3, rtol=1e-9)
        return
    np.testing.assert_allclose((found.position - point) @ normal, 0.0, atol=1e-12)
    before = Plane((0.0, 0.0, -0.2e-3), (0.0, 0.0, 1.0))
    again = trace(bent_field(geometry), RayBundle(found.position, -found.direction), until=before, **OPTIONS)
    np.testing.assert_allclose(again.position, rays.position, atol=1e-12)
    np.testing.assert_allclose(again.direction, -rays.direction, atol=1e-12)
