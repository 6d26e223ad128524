"""Perfect lenses: Luneburg's focuses parallel light on its rim, Maxwell's fish-eye images every point."""

import numpy as np
import pytest

from aerokernels.rays import RayBundle
from aerokernels.tracing import ArcLength, trace
from tests.physics.exact_ends import unit

from .checks import assert_float32, assert_float64, case
from .media import N0

LUNEBURG = ("Luneburg planar", "Luneburg axisymmetric", "Luneburg volume", "Luneburg planar, half way")
FISH_EYE = ("fish-eye planar", "fish-eye axisymmetric", "fish-eye planar, half way")


@pytest.mark.parametrize("name", LUNEBURG)
def test_luneburg(name):
    """Parallel rays, some oblique to the grid, some skew, to the focus at the far rim and to a plane short of it.

    Formula: n^2 = 2 - r^2 / R^2, r = r0 cos(sigma / R) + T0 R sin(sigma / R) (media.quadratic_ends). Errors: none from
    the grid; steps, 1e-6 wave, 5e-13 of the path. Tolerance: 1e-10 of the path (see test_parabolic.py).
    """
    assert_float64(case(name), 1e-10, tolerance=1e-6)


@pytest.mark.parametrize("name", LUNEBURG[:3])
def test_luneburg_focuses_with_equal_paths(name):
    """All rays end in one point, the far end of the diameter along them; paths from a plane before the lens agree.

    Expected: R (1 + pi / 2) from the plane that touches the near rim, of which R - depth lies in air of index 1.
    """
    lens = case(name)
    towards = lens.until.normal
    result = trace(lens.field, lens.rays, until=lens.until, precision="float64", tolerance=1e-6)
    assert np.abs(result.position - towards).max() < 1e-10
    in_air = 1.0 + lens.rays.position @ towards
    assert np.abs(in_air + result.optical_path - (1.0 + 0.5 * np.pi)).max() < 1e-10
    # The tangent there is the start seen from behind: T = -r0 / R at sigma = pi R / 2.
    assert np.abs(result.direction + lens.rays.position).max() < 1e-10


@pytest.mark.parametrize("name", FISH_EYE)
def test_fish_eye(name):
    """A fan through 130 degrees from a point to its antipodal image, and to a plane short of it.

    Formula: great circles of the stereographic sphere (media.fish_eye_ends). Errors: the grid, which may bend a ray by
    3e-9 where it runs along a row of cells (see cases.py); steps, 3e-13. Tolerance: 3e-9 of the path.
    """
    assert_float64(case(name), 3e-9, tolerance=1e-6)


@pytest.mark.parametrize("name", FISH_EYE[:2])
def test_fish_eye_images_with_equal_paths(name):
    """All rays meet at -R^2 r0 / r0^2, and each has taken the optical path pi n0 R / 2. Tolerance as above."""
    lens = case(name)
    source = lens.rays.position[0]
    result = trace(lens.field, lens.rays, until=lens.until, precision="float64", tolerance=1e-6)
    assert np.abs(result.position + source / (source @ source)).max() < 3e-9 * lens.ends.arc_length.min()
    assert np.abs(result.optical_path - 0.5 * np.pi * N0).max() < 3e-9 * lens.ends.arc_length.min()


@pytest.mark.parametrize("name", FISH_EYE[:2])
def test_fish_eye_rays_are_circles(name):
    """Several lengths along the rays: they lie on the circle through source and image that they set out on.

    Formula: the chord c from source to image and the angle a between it and the start give the radius c / (2 sin a),
    run through evenly: r = r0 + rho (d sin(s / rho) + e (1 - cos(s / rho))), e across d in the plane of the chord.
    The ray through the centre, a = 0, is left out. Tolerance as above.
    """
    lens = case(name)
    rays = RayBundle(lens.rays.position[[0, 1, 4, 5]], lens.rays.direction[[0, 1, 4, 5]])
    source, start = rays.position, rays.direction
    chord = -source / np.sum(source**2, axis=1, keepdims=True) - source
    aside = chord - np.sum(chord * start, axis=1, keepdims=True) * start
    inward = unit(aside)
    rho = np.sum(chord**2, axis=1, keepdims=True) / (2.0 * np.linalg.norm(aside, axis=1, keepdims=True))
    for length in (0.2, 0.9, 1.6, 2.0):
        result = trace(lens.field, rays, until=ArcLength(length), precision="float64", tolerance=1e-6)
        turn = length / rho
        place = source + rho * (start * np.sin(turn) + inward * (1.0 - np.cos(turn)))
        assert result.ok.all()
        assert np.abs(result.position - place).max() < 3e-9 * length
        assert np.abs(result.direction - (start * np.cos(turn) + inward * np.sin(turn))).max() < 3e-9 * length


@pytest.mark.usefixtures("both_backends")
@pytest.mark.parametrize("name", LUNEBURG[:3] + FISH_EYE[:2])
def test_float32(name):
    """The lenses in float32; tolerance: see assert_float32."""
    assert_float32(case(name))
