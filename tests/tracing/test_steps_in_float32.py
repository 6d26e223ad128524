"""Rays whose steps rounding keeps short in float32: float64 decides whether they arrive."""

import numpy as np
import pytest

from aerokernels import IndexField, Plane, RayBundle, trace
from aerokernels.tracing import RayStatus
from tests.draws.mesh_draws import draw

ENGINES = ("warp", "opencl")
SHORT_OF_STEPS = (13, 56, 76)  # of the drawn rays: MAX_STEPS in float32, after 72,231 steps


@pytest.mark.parametrize("backend", ENGINES)
@pytest.mark.parametrize("outputs", [None, ("opd",)])
def test_a_ray_that_float64_traces_is_not_out_of_steps(backend: str, outputs):
    """Set-up: inverse distances on 6024 cells, a steep stop, 1e-4 wave: step control finds no end in float32.

    Expected: what float64 gives within the tolerance, with and without step_error among the outputs; a neighbour that
    needs no float64 has the results of float32 alone.
    """
    case = draw(5017, 512)
    given = {"until": case.until, "tolerance": case.tolerance, "backend": backend, "method": "adaptive"}
    rows = np.array([*SHORT_OF_STEPS, 0])
    found = trace(case.field, case.rays[rows], outputs=outputs, **given)
    double = trace(case.field, case.rays[rows], precision="float64", **given)
    assert RayStatus.MAX_STEPS not in double.status and np.array_equal(found.status, double.status)
    assert np.abs(found.opd - double.opd).max() < case.tolerance * 905e-9
    alone = trace(case.field, case.rays[rows[3:]], outputs=outputs, **given)
    assert found.opd[3] == alone.opd[0] and (outputs or (found.step_error <= case.tolerance * 905e-9).all())


@pytest.mark.parametrize("backend", ENGINES)
def test_a_trapped_ray_is_out_of_steps_in_either_precision(backend: str):
    """The circle r = 1 of Maxwell's fish-eye has no end. Expected: MAX_STEPS, the error of float64's steps, finite."""
    axis = np.arange(-24, 25) / 16.0
    y, z = np.meshgrid(axis, axis, indexing="ij")
    field = IndexField.from_samples(
        2.0 / (1.0 + y**2 + z**2) - 0.6, origin=(-1.5, -1.5), spacing=(1 / 16, 1 / 16), geometry="planar",
        ambient_index=0.6,
    )  # fmt: skip
    rays = RayBundle([[0.0, 1.0, 0.0]], [[0.0, 0.0, 1.0]])
    given = {"until": Plane((0, 0, 2.0), (0, 0, 1)), "max_steps": 300, "method": "adaptive", "backend": backend}
    for precision in ("float32", "float64"):
        found = trace(field, rays, precision=precision, **given)
        assert found.status[0] == RayStatus.MAX_STEPS and found.step_count[0] == 300 and np.isfinite(found.step_error)


@pytest.mark.parametrize("backend", ENGINES)
@pytest.mark.parametrize(("distance", "obliquity"), [(2.0, 1.0), (100.0, 0.3)])
def test_an_even_layer_does_not_hide_its_rounding_from_a_far_stop(backend: str, distance: float, obliquity: float):
    """Set-up: a blob of 1e-9 on an even layer of 3e-4, 200 cells along the rays, and a far plane met at a slant.

    In float32 the slope of the blob is a difference of coefficients as great as the layer's: it is wrong by up to
    2^-24 x 3e-4 a cell, which does not average out, and the stop magnifies it by its distance times the tangent.

    Expected: where the status is OK, the OPD of the float64 reference within the tolerance and the ray's own estimate.
    """
    y, z = (np.arange(40) - 19.5) * 5e-4, np.arange(200) * 5e-4
    layer = 3e-4 * 0.25 * (1 + np.tanh((z - 0.02) / 3e-3)) * (1 - np.tanh((z - 0.08) / 3e-3))
    blob = 1e-9 * np.exp(-(y[:, None] ** 2 + (z - 0.05) ** 2) / (2 * 3e-3**2))
    field = IndexField.from_samples(
        layer + blob, origin=(y[0], 0.0), spacing=(5e-4, 5e-4), geometry="planar", ambient_index=1.0003
    )
    rays = RayBundle(
        np.c_[np.zeros(64), np.linspace(-5e-3, 5e-3, 64), np.full(64, -1e-3)], np.tile([0, 0, 1.0], (64, 1))
    )
    given = {"until": Plane((0, 0, distance), (0, np.sin(obliquity), np.cos(obliquity))), "wavelength": 905e-9}
    truth = trace(field, rays, backend="reference", tolerance=1e-5, **given).opd
    found = trace(field, rays, backend=backend, tolerance=1e-3, **given)
    assert (found.status == RayStatus.OK).all()
    assert np.abs(found.opd - truth).max() < 1e-3 * 905e-9
    assert (np.abs(found.opd - truth) < found.step_error + 1e-12).all()
