"""n = n0 sech(g y): meridional rays of every slope have the same period 2 pi / g and the same optical path over it."""

import pytest

from tests.slow import first_of

from .checks import assert_float64, case


@pytest.mark.parametrize("geometry", first_of(["planar", "axisymmetric"]))
def test_rays_of_all_slopes(geometry):
    """Two periods, 13 lengths 1/g, slopes up to 44 degrees.

    Formula: sinh(g y) = A sin(g l + phase), l along x and z; optical path n0 / g times the growth of
    arctan(sqrt(1 + A^2) tan(g l + phase)) (media.sech_ends). Errors: the grid, which may bend a turning ray by 1.6e-9
    in each turn (see cases.py), steps 1e-13 of the path. Tolerance: 2e-9 of the path.
    """
    assert_float64(case(f"sech {geometry}"), 2e-9, tolerance=1e-6)
