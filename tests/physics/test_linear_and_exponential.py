"""Layered media without a period: n^2 linear in position, whose rays are parabolas, and n exponential in y."""

import numpy as np
import pytest

from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, trace

from .checks import assert_float64, case
from .media import N0

LINEAR = ("linear planar", "linear axisymmetric", "linear volume")


@pytest.mark.parametrize("name", LINEAR)
def test_parabolas(name):
    """In n^2 = n0^2 + 2 f.r, f oblique to the grid, 2 m: r = r0 + T0 sigma + f sigma^2 / 2.

    Optical path n^2(start) sigma + T0.f sigma^2 + f^2 sigma^3 / 3 (media.quadratic_ends). Errors: the interpolant and
    every step are exact, so only rounding of a few steps is left. Tolerance: 1e-13 of the path.
    """
    assert_float64(case(name), 1e-13, tolerance=1e-6)


def test_a_ray_turns_where_the_parabola_does():
    """In n^2 = n0^2 + 2 f y, f = -0.5, with f_z = 0.2: the top of a rising ray, on the plane through it.

    Formula: T_y = 0 at sigma = -T_y0 / f, so the top is T_y0^2 / (2 |f|) above the start and the ray runs level there.
    A stop plane across z through the top meets it squarely. Tolerance: 1e-13 m, as above.
    """
    field = case("linear planar").field
    start = np.array([0.0, -0.5, 0.0])
    n = np.sqrt(N0**2 + 0.5)
    rays = RayBundle([start], [[0.0, 0.3, 1.0]])
    _, rise, run = n * rays.direction[0]
    sigma = rise / 0.5
    top = start + np.array([0.0, rise**2 / (2.0 * 0.5), run * sigma + 0.1 * sigma**2])
    result = trace(field, rays, until=Plane(top, (0.0, 0.0, 1.0)), precision="float64", tolerance=1e-6)
    assert np.abs(result.position[0] - top).max() < 1e-13
    assert np.abs(result.direction[0] - [0.0, 0.0, 1.0]).max() < 1e-13


def test_catenaries_of_equal_strength():
    """In n = n0 exp(y / L) the slope grows evenly along z, y = y0 + L ln(cos(slope0) / cos(slope)).

    Rays that fall at up to 55 degrees, turn and rise again over 1.6 L, two of them with a component along x; their
    optical path is in media.exponential_ends. Errors: the grid, which may bend a turning ray by 1.6e-9 (see cases.py),
    about doubled where the ray has become steep; steps, 5e-13. Tolerance: 4e-9 of the path.
    """
    assert_float64(case("exponential planar"), 4e-9, tolerance=1e-6)
