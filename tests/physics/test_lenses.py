"""Perfect lenses: Luneburg's focuses parallel light on its rim, Maxwell's fish-eye images every point."""

import pytest

from .checks import assert_float32, assert_float64, case

LUNEBURG = ("Luneburg planar", "Luneburg axisymmetric", "Luneburg volume", "Luneburg planar, half way")
FISH_EYE = ("fish-eye planar", "fish-eye axisymmetric", "fish-eye planar, half way")


@pytest.mark.parametrize("name", LUNEBURG)
def test_luneburg(name):
    """Parallel rays, some oblique to the grid, some skew, to the focus at the far rim and to a plane short of it.

    Formula: n^2 = 2 - r^2 / R^2, r = r0 cos(sigma / R) + T0 R sin(sigma / R) (media.quadratic_ends). Errors: none from
    the grid; steps, 1e-6 wave, 5e-13 of the path. Tolerance: 1e-10 of the path (see test_parabolic.py).
    """
    assert_float64(case(name), 1e-10, tolerance=1e-6)


@pytest.mark.parametrize("name", FISH_EYE)
def test_fish_eye(name):
    """A fan through 130 degrees from a point to its antipodal image, and to a plane short of it.

    Formula: great circles of the stereographic sphere (media.fish_eye_ends). Errors: the grid, which may bend a ray by
    3e-9 where it runs along a row of cells (see cases.py); steps, 3e-13. Tolerance: 3e-9 of the path.
    """
    assert_float64(case(name), 3e-9, tolerance=1e-6)


@pytest.mark.usefixtures("both_backends")
@pytest.mark.parametrize("name", LUNEBURG[:3] + FISH_EYE[:2])
def test_float32(name):
    """The lenses in float32; tolerance: see assert_float32."""
    assert_float32(case(name))
