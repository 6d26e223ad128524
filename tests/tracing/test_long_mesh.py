"""Many rays through a mesh that is not resampled: a warning before they are traced, by what a few of them need."""

import warnings

import numpy as np
import pytest

from aerokernels import Disc, IndexField, Plane, QuadMesh, RayBundle, estimate_strehl, trace
from aerokernels.tracing import planning

from .backends import on

DISC = Disc(4e-3, (0.0, 0.0, -1.1e-2), (0.0, 0.1, 1.0))


def mesh_field(count: int = 24) -> IndexField:
    """Blob of a contrast of 1e-4 on a mesh of squares."""
    y, z = np.meshgrid(*[np.linspace(-1e-2, 1e-2, count)] * 2, indexing="ij")
    mesh = QuadMesh.structured(y, z, geometry="planar")
    return IndexField.from_mesh(mesh, 1e-4 * np.exp(-((y / 3e-3) ** 2 + (z / 3e-3) ** 2)))


@pytest.mark.parametrize("backend", ["opencl-cpu", "warp-cpu"])
def test_many_rays_through_a_mesh_warn_before_they_are_traced(backend: str, monkeypatch):
    """With the number of evaluations that the rays then need, and a remedy that gives the same answer without it."""
    field, rays = mesh_field(), RayBundle.collimated(DISC, 2500)
    asked = {"until": Plane((0.0, 0.0, 1.2e-2), (0.0, 0.0, 1.0)), "wavelength": 905e-9, **on(backend)}
    monkeypatch.setattr(planning, "LONG", 1e5)
    with pytest.warns(UserWarning, match=r"evaluations for each of 2,500 rays.* field\.resample\(tolerance=0\.001\)"):
        found = trace(field, rays, **asked)
    assert found.plan.predicted_evaluations == pytest.approx(np.mean(found.evaluation_count), rel=0.5)
    assert any("a mesh, not resampled" in reason for reason in found.plan.reasons)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        grid = trace(field.resample(tolerance=1e-3, wavelength=905e-9), rays, **asked)
        trace(field, rays.rows(np.arange(100)), **asked)
    within = np.hypot(found.error["total"], grid.error["total"]) + 1e-3 * 905e-9
    assert np.abs(found.opd - grid.opd).max() < within


def test_a_pupil_through_a_mesh_warns_too(monkeypatch):
    monkeypatch.setattr(planning, "LONG", 1e4)
    with pytest.warns(UserWarning, match="through this mesh error control needs about"):
        estimate_strehl(mesh_field(12), DISC, wavelength=905e-9, ray_count=3000, **on("opencl-cpu"))


def test_few_evaluations_do_not_warn():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        trace(mesh_field(12), RayBundle.collimated(DISC, 2500), wavelength=905e-9, **on("opencl-cpu"))
