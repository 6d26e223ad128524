"""n = n0 sech(g y): meridional rays of every slope have the same period 2 pi / g and the same optical path over it."""

import numpy as np
import pytest

from aerokernels.rays import RayBundle
from aerokernels.tracing import trace
from tests.slow import first_of

from .checks import assert_float64, case
from .media import N0, across_z


@pytest.mark.parametrize("geometry", first_of(["planar", "axisymmetric"]))
def test_rays_of_all_slopes(geometry):
    """Ten periods, 63 lengths 1/g, slopes up to 44 degrees.

    Formula: sinh(g y) = A sin(g l + phase), l along x and z; optical path n0 / g times the growth of
    arctan(sqrt(1 + A^2) tan(g l + phase)) (media.sech_ends). Errors: the grid, which may bend a turning ray by 1.6e-9
    in each turn (see cases.py), steps 1e-13 of the path. Tolerance: 2e-9 of the path.
    """
    assert_float64(case(f"sech {geometry}"), 2e-9, tolerance=1e-6)


@pytest.mark.parametrize("geometry", first_of(["axisymmetric", "planar"]))
def test_a_fan_refocuses(geometry):
    """A fan from a point on the axis meets there again after every half period, slopes mirrored, all paths alike.

    Expected, whatever the slope: y = 0 and optical path m pi n0 / g at z = m pi / g; off the axis, start and direction
    are back after whole periods. Tolerance as above.
    """
    g = 10.0
    field = case(f"sech {geometry}").field
    slope = np.array([-0.9, -0.5, -0.1, 0.0, 0.3, 0.7, 1.0])
    aim = np.stack([np.zeros_like(slope), slope, np.ones_like(slope)], axis=1)
    rays = RayBundle(np.zeros_like(aim), aim)
    for half_periods in (1, 10):
        z = half_periods * np.pi / g
        result = trace(field, rays, until=across_z(z), precision="float64", tolerance=1e-6)
        assert result.ok.all()
        assert np.abs(result.position - [0.0, 0.0, z]).max() < 2e-9 * z
        assert np.abs(result.direction - rays.direction * [1.0, (-1.0) ** half_periods, 1.0]).max() < 2e-9 * z * g
        assert np.abs(result.optical_path - half_periods * np.pi * N0 / g).max() < 2e-9 * z
    aside = RayBundle(aim * [0.0, 0.02, 0.0] + [0.0, 0.05, 0.0], aim * [1.0, 0.5, 1.0])
    result = trace(field, aside, until=across_z(2.0 * np.pi / g * 4), precision="float64", tolerance=1e-6)
    path = 4 * 2.0 * np.pi / g
    assert np.abs(result.position[:, :2] - aside.position[:, :2]).max() < 2e-9 * path
    assert np.abs(result.direction - aside.direction).max() < 2e-9 * path * g
    assert np.abs(result.optical_path - N0 * path).max() < 2e-9 * path
