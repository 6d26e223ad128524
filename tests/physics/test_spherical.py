"""Spherically symmetric media: rays stay in a plane through the centre and keep Bouguer's n r sin(psi)."""

import numpy as np
import pytest
from scipy.integrate import quad

from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane
from tests.physics.exact_ends import Ends

from .checks import assert_float32, assert_float64, case
from .closed_forms import Case, build_field

POWERS = (
    "spherical p=-1 planar",
    "spherical p=-1 axisymmetric",
    "spherical p=-1/2 axisymmetric",
    "spherical p=2 planar",
    "spherical p=2 volume",
)


@pytest.mark.parametrize("name", POWERS)
def test_powers_of_the_radius(name):
    """In n = n0 (r / R)^p past a centre outside the box, meridional and skew rays, to a plane through the centre.

    Formula: r^(p+1) cos(b) is constant, where the climb b = pi/2 - psi grows by p + 1 times the polar angle
    (media.power_ends). Errors: the grid, 3e-9 at most (see cases.py); steps, 1e-12. Tolerance: 3e-9 of the path.
    """
    assert_float64(case(name), 3e-9, tolerance=1e-6)


@pytest.mark.parametrize("name", POWERS)
def test_float32(name):
    """The same in float32; tolerance: see assert_float32."""
    assert_float32(case(name))


def plummer(geometry: str) -> Case:
    """The medium n^2 = c + k / sqrt(r^2 + b^2): a ray from 0.8, its least distance from the centre, to 1.2.

    With K = n r at the least distance, F = n^2 r^2 - K^2 and r = r_least + u^2, the polar angle is the integral of
    K / (r sqrt(F)) dr, the optical path that of n^2 r / sqrt(F) dr, the length that of n r / sqrt(F) dr. F vanishes at
    u = 0; F / (r^2 - r_least^2), with A = sqrt(r^2 + b^2), is c + k (1 + b^2 / (A A_least)) / (A + A_least), which does
    not cancel. The integrals, by adaptive Gauss-Kronrod, are good to 1e-13.
    """
    c, k, b, least, most = 1.2, 1.0, 0.5, 0.8, 1.2

    def square(r2):
        return c + k / np.sqrt(r2 + b**2)

    kept = least * np.sqrt(square(least**2))

    def integrate(weight):
        def integrand(u):
            r = least + u * u
            a, a_least = np.sqrt(r * r + b**2), np.sqrt(least**2 + b**2)
            ratio = c + k * (1.0 + b**2 / (a * a_least)) / (a + a_least)
            return weight(r) * 2.0 / np.sqrt(ratio * (r + least))

        value, error = quad(integrand, 0.0, np.sqrt(most - least), epsabs=0.0, epsrel=1e-13)
        assert error < 1e-13
        return value

    angle = integrate(lambda r: kept / r)
    optical_path = integrate(lambda r: square(r * r) * r)
    length = integrate(lambda r: np.sqrt(square(r * r)) * r)
    outward = np.array([0.0, -0.6, 0.8])
    onward = np.array([0.0, 0.8, 0.6]) if geometry == "planar" else np.array([0.6, 0.64, 0.48])
    here = np.cos(angle) * outward + np.sin(angle) * onward
    ahead = np.cos(angle) * onward - np.sin(angle) * outward
    sine = kept / (most * np.sqrt(square(most**2)))
    ends = Ends(
        position=most * here[None],
        direction=(np.sqrt(1.0 - sine**2) * here + sine * ahead)[None],
        optical_path=np.array([optical_path]),
        arc_length=np.array([length]),
    )

    def index(points):
        return np.sqrt(square(np.sum(points**2, axis=-1)))

    axes = {"planar": [(-0.6, 0.5, 280)], "axisymmetric": [(0.0, 0.9, 230)]}[geometry]
    field = build_field(index, geometry, [*axes, (0.5, 1.4, 230)], 1.4)
    rays = RayBundle([least * outward], [onward])
    return Case(index, field, rays, Plane((0.0, 0.0, 0.0), ahead), ends, 1.0)


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_a_medium_with_a_quadrature_only(geometry):
    """In n^2 = c + k / sqrt(r^2 + b^2), angle, optical path and length from Bouguer's integrals: see `plummer`.

    Expected at the plane at that angle: radius 1.2, and the climb that Bouguer's invariant gives. Errors and tolerance
    as for the powers: the fourth derivative is less than theirs.
    """
    assert_float64(plummer(geometry), 3e-9, tolerance=1e-6)
