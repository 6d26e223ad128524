"""Layered media without a period: n^2 linear in position, whose rays are parabolas, and n exponential in y."""

import pytest

from .checks import assert_float64, case

LINEAR = ("linear planar", "linear axisymmetric", "linear volume")


@pytest.mark.parametrize("name", LINEAR)
def test_parabolas(name):
    """In n^2 = n0^2 + 2 f.r, f oblique to the grid, 2 m: r = r0 + T0 sigma + f sigma^2 / 2.

    Optical path n^2(start) sigma + T0.f sigma^2 + f^2 sigma^3 / 3 (media.quadratic_ends). Errors: the interpolant and
    every step are exact, so only rounding of a few steps is left. Tolerance: 1e-13 of the path.
    """
    assert_float64(case(name), 1e-13, tolerance=1e-6)


def test_catenaries_of_equal_strength():
    """In n = n0 exp(y / L) the slope grows evenly along z, y = y0 + L ln(cos(slope0) / cos(slope)).

    Rays that fall at up to 55 degrees, turn and rise again over 1.6 L, two of them with a component along x; their
    optical path is in media.exponential_ends. Errors: the grid, which may bend a turning ray by 1.6e-9 (see cases.py),
    about doubled where the ray has become steep; steps, 5e-13. Tolerance: 4e-9 of the path.
    """
    assert_float64(case("exponential planar"), 4e-9, tolerance=1e-6)
