"""n^2 = n0^2 (1 - g^2 r^2): every ray swings harmonically in sigma, d sigma = ds / n, with frequency n0 g."""

import pytest

from tests.slow import first_of

from .checks import assert_float32, assert_float64, case
from .media import parabolic


@pytest.mark.parametrize("geometry", first_of(["axisymmetric", "planar", "volume"]))
def test_meridional_skew_and_helical_rays(geometry):
    """Two pitches, 13 lengths 1/g: position, direction and optical path of rays of every kind.

    Formula: x_i = x_i0 cos(n0 g sigma) + T_i0 / (n0 g) sin(n0 g sigma), T_z constant; the optical path is the integral
    of n^2 d sigma (media.quadratic_ends). Errors: none from the grid, for the potential is a parabola; the steps, 1e-6
    wave or 1e-13 of the path; rounding of 4e4 steps. Tolerance: 1e-10 of the path, as the optical path's budget leaves
    position, counted with the slope of the ray, up to a hundred times more.
    """
    assert_float64(case(f"parabolic {geometry}"), 1e-10, tolerance=1e-6)


@pytest.mark.slow
def test_a_hundred_pitches():
    """628 lengths 1/g = 6.3 m, 1300 radii of the rod, in float64 and float32.

    Sums over a long path are those of every geometry, which the other tests go through. Formula and errors as above; a
    phase error grows with the path, so it must be below 1e-8 of the path, that is 6e-6 rad in 628 rad, in float64. In
    float32: see assert_float32.
    """
    rod = parabolic("axisymmetric", 100.0, g=100.0)
    assert_float64(rod, 1e-8, tolerance=1e-4)
    assert_float32(rod)
