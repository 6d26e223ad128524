"""Steps on linear grids end a little before a face: over the rest the slope goes on changing as it does in the cell."""

import numpy as np
import pytest

from aerokernels import IndexField, Plane, RayBundle, trace

from .backends import ENGINES, WAVE, on


@pytest.mark.parametrize("engine", ENGINES)
def test_strong_fields_converge_with_the_tolerance(engine: str):
    """Skew rays through a Gaussian of contrast -0.04, 8 nodes wide, against the reference engine (1e-11 waves).

    Near a face a step stops up to 1e-3 cells ahead. If the slope were constant over that rest, a direction would err by
    up to half of the rest squared times the change of the slope in the cell: 5e-9 rad and 4e-5 waves, whatever the
    tolerance.
    """
    y, z = 7.3e-5 * (np.arange(8) - 3.5), 5.1e-5 * (np.arange(5) - 2.0)
    contrast = -0.04 * np.exp(-(((y[:, None] + 5e-5) / 1.6e-4) ** 2) - ((z - 1e-5) / 1.0e-4) ** 2)
    field = IndexField.from_samples(
        contrast,
        origin=(y[0], z[0]),
        spacing=(y[1] - y[0], z[1] - z[0]),
        geometry="planar",
        ambient_index=1.000273,
        interpolation="linear",
    )
    rng = np.random.default_rng(3)
    position = np.c_[np.zeros(64), rng.uniform(-1e-4, 1e-4, 64), np.full(64, -3e-4)]
    direction = np.c_[np.full(64, 0.3), rng.uniform(-0.7, 0.7, 64), np.ones(64)]
    options = {"until": Plane((0.0, 0.0, 3e-4), (0.0, 0.0, 1.0)), "wavelength": WAVE, "tolerance": 1e-6}
    rays = RayBundle(position, direction)
    exact = trace(field, rays, backend="reference", **options)
    result = trace(field, rays, precision="float64", **on(engine), **options)
    assert np.array_equal(result.status, exact.status)
    assert np.abs(result.opd - exact.opd).max() < 1e-6 * WAVE
    assert np.abs(result.direction - exact.direction).max() < 1e-10


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_ray_that_starts_in_a_face_takes_the_slope_of_the_cell_it_flies_into(engine: str, sense: float):
    """A ray starts in the node plane y = 0, beyond which the contrast rises at 1.4 / m to one side only.

    It leaves to the other side, where all is uniform: neither its direction nor its path may change, whatever the
    tolerance. With the slope of the other cell it turned by 0.02 rad in the first step.
    """
    y, z = 2.5e-4 * (np.arange(9) - 4.0), 2.5e-3 * (np.arange(9) - 4.0)
    contrast = 1.4 * np.maximum(sense * y, 0.0)[:, None] + 0.0 * z
    field = IndexField.from_samples(
        contrast, origin=(y[0], z[0]), spacing=(y[1] - y[0], z[1] - z[0]), geometry="planar", interpolation="linear"
    )
    rays = RayBundle([[0.0, 0.0, -1e-3]], [[0.0, -2.6e-4 * sense, 1.0]])
    until = Plane((0.0, 0.0, 5e-3), (0.0, 0.0, 1.0))
    result = trace(field, rays, until=until, tolerance=0.1, wavelength=WAVE, **on(engine))
    assert np.abs(result.direction - rays.direction).max() < 1e-6
    assert np.abs(result.opd).max() < 1e-4 * WAVE
