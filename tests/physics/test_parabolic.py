"""n^2 = n0^2 (1 - g^2 r^2): every ray swings harmonically in sigma, d sigma = ds / n, with frequency n0 g."""

import numpy as np
import pytest

from aerokernels.rays import RayBundle
from aerokernels.tracing import ArcLength, trace

from .checks import assert_float32, assert_float64, case
from .media import parabolic

GEOMETRIES = ("planar", "axisymmetric", "volume")


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_meridional_skew_and_helical_rays(geometry):
    """Ten pitches, 63 lengths 1/g: position, direction and optical path of rays of every kind.

    Formula: x_i = x_i0 cos(n0 g sigma) + T_i0 / (n0 g) sin(n0 g sigma), T_z constant; the optical path is the integral
    of n^2 d sigma (media.quadratic_ends). Errors: none from the grid, for the potential is a parabola; the steps, 1e-6
    wave or 1e-13 of the path; rounding of 2e5 steps. Tolerance: 1e-10 of the path, as the optical path's budget leaves
    position, counted with the slope of the ray, up to a hundred times more.
    """
    assert_float64(case(f"parabolic {geometry}"), 1e-10, tolerance=1e-6)


def test_a_hundred_pitches():
    """628 lengths 1/g = 6.3 m, 1300 radii of the rod, in float64 and float32.

    Sums over a long path are those of every geometry, which the other tests go through. Formula and errors as above; a
    phase error grows with the path, so it must be below 1e-8 of the path, that is 6e-6 rad in 628 rad, in float64. In
    float32: see assert_float32.
    """
    rod = parabolic("axisymmetric", 100.0, g=100.0)
    assert_float64(rod, 1e-8, tolerance=1e-4)
    assert_float32(rod)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_float32(geometry):
    """The ten pitches of above in float32; tolerance: see assert_float32."""
    assert_float32(case(f"parabolic {geometry}"))


@pytest.mark.parametrize("geometry", ["axisymmetric", "volume"])
def test_a_helix_along_its_length(geometry):
    """A ray at radius r with tangential momentum n0 g r winds about the axis: looked at after several lengths of arc.

    Formula: the index n on it is constant, so sigma = s / n, angle n0 g sigma, z = T_z sigma, optical path n s. Errors
    and tolerance as above, 1e-10 of the length.
    """
    rod = case(f"parabolic {geometry}")
    n0, g, radius = 1.5, 10.0, 0.02
    n = n0 * np.sqrt(1.0 - (g * radius) ** 2)
    across, along = n0 * g * radius, n0 * np.sqrt(1.0 - 2.0 * (g * radius) ** 2)
    rays = RayBundle([[radius, 0.0, 0.0]], [[0.0, across, along]])
    for length in (0.11, 1.7, 3.9, 6.2):
        result = trace(rod.field, rays, until=ArcLength(length), precision="float64", tolerance=1e-6)
        angle = n0 * g * length / n
        place = [radius * np.cos(angle), radius * np.sin(angle), along * length / n]
        tangent = np.array([-across * np.sin(angle), across * np.cos(angle), along]) / n
        assert np.abs(result.position[0] - place).max() < 1e-10 * length
        assert np.abs(result.direction[0] - tangent).max() < 1e-10 * length * g
        assert abs(result.optical_path[0] - n * length) < 1e-10 * length
        assert abs(result.arc_length[0] - length) < 1e-14
