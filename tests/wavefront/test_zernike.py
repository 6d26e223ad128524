"""Zernike polynomials: orthonormality, the published order, and other packages' own."""

import numpy as np
import pytest

from aerokernels import zernike
from aerokernels.pupils import unit_disc_samples

# R. J. Noll (1976), table I: (n, m), m negative for sines.
NOLL = [(0, 0), (1, 1), (1, -1), (2, 0), (2, -2), (2, 2), (3, -1), (3, 1), (3, -3), (3, 3), (4, 0), (4, 2), (4, -2)]


def test_indices_are_those_published():
    assert [zernike.noll_to_nm(j) for j in range(1, 14)] == NOLL


def test_polynomials_are_orthonormal_over_the_disc():
    """Gauss points integrate polynomials of degree 40 exactly: the Gram matrix of 66 modes is the identity."""
    points, weight = unit_disc_samples(4 * 30**2, "gauss")
    modes = zernike.zernike_modes(66, *points.T)
    assert np.abs((modes * weight) @ modes.T - np.eye(66)).max() < 1e-12


def test_high_orders_keep_their_digits():
    """Z(n, 0) at the rim is sqrt(n + 1), and rms 1: a sum of factorials has no digit left at n = 60."""
    assert zernike.zernike_polynomial(60, 0, 1.0, 0.0) == pytest.approx(np.sqrt(61.0), rel=1e-12)
    points, weight = unit_disc_samples(4 * 80**2, "gauss")
    high = zernike.zernike_polynomial(60, -20, *points.T)
    assert weight @ high**2 == pytest.approx(1.0, rel=1e-10)


def test_closed_forms():
    """Tilt 2 x, focus sqrt(3) (2 r^2 - 1), astigmatism 2 sqrt(6) x y, coma sqrt(8) (3 r^2 - 2) y."""
    x, y = np.random.default_rng(0).uniform(-0.7, 0.7, (2, 50))
    square = x * x + y * y
    forms = {
        1: 1.0 + 0.0 * x,
        2: 2.0 * x,
        3: 2.0 * y,
        4: np.sqrt(3.0) * (2.0 * square - 1.0),
        5: 2.0 * np.sqrt(6.0) * x * y,
        6: np.sqrt(6.0) * (x * x - y * y),
        7: np.sqrt(8.0) * (3.0 * square - 2.0) * y,
        8: np.sqrt(8.0) * (3.0 * square - 2.0) * x,
        11: np.sqrt(5.0) * (6.0 * square**2 - 6.0 * square + 1.0),
    }
    modes = zernike.zernike_modes(11, x, y)
    for index, expected in forms.items():
        assert np.abs(modes[index - 1] - expected).max() < 1e-13, index


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: zernike.noll_to_nm(0), "a Noll index is a whole number of at least 1, got 0"),
        (lambda: zernike.noll_to_nm(1.5), "index must be a whole number"),
        (lambda: zernike.zernike_modes(0, 0.0, 0.0), "whole number of at least 1, got 0"),
        (lambda: zernike.zernike_polynomial(2, 1, 0.0, 0.0), r"n - m even, got \(2, 1\)"),
        (lambda: zernike.zernike_polynomial(1, 3, 0.0, 0.0), r"got \(1, 3\)"),
    ],
)
def test_what_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_prysm_has_the_same_polynomials_and_indices():
    polynomials = pytest.importorskip("prysm.polynomials")
    x, y = np.random.default_rng(1).uniform(-0.7, 0.7, (2, 200))
    for index in range(1, 67):
        n, m = zernike.noll_to_nm(index)
        assert tuple(polynomials.noll_to_nm(index)) == (n, m)
        theirs = polynomials.zernike_nm(n, m, np.hypot(x, y), np.arctan2(y, x), norm=True)
        assert np.abs(theirs - zernike.zernike_polynomial(n, m, x, y)).max() < 1e-11
