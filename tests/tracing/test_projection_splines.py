"""Integrals along z of spline coefficients, and splines over x and y, beside SciPy's own splines."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from aerokernels.tracing import projection_splines

COUNT = 9  # coefficients along z: cells 0 to 5
COEFFICIENTS = np.random.default_rng(3).normal(size=COUNT)


def scipys(coefficients: np.ndarray) -> BSpline:
    """The uniform cubic spline whose cell k is made of coefficients k to k + 3; places in cells."""
    return BSpline(np.arange(len(coefficients) + 4) - 3.0, coefficients, 3, extrapolate=False)


def test_integrals_of_steps_are_scipys():
    """Steps inside a cell, over boundaries of cells, and up to the last node; polynomials are exact: 1e-13.

    The twofold integral from u to v is that of (v - z) s(z).
    """
    begin = np.array([0.25, 0.75, 1.5, 3.125, 5.5])
    end = np.array([0.75, 1.5, 3.125, 5.5, 6.0])
    factors = np.array([[1.0, -2.0], [0.5, 3.0]])
    planes = COEFFICIENTS[:, None, None] * factors
    value, single, double = projection_splines.integrals(planes, begin, end)
    spline = scipys(COEFFICIENTS)
    nodes, weights = np.polynomial.legendre.leggauss(4)
    for row, (u, v) in enumerate(zip(begin, end, strict=True)):
        edges = np.unique([u, *np.arange(np.ceil(u), v), v])
        half, middle = 0.5 * np.diff(edges)[:, None], 0.5 * (edges[1:] + edges[:-1])[:, None]
        places, weight = middle + half * nodes, half * weights
        once, twice = (weight * spline(places)).sum(), (weight * (v - places) * spline(places)).sum()
        expected = float(spline(min(v, 6.0 - 1e-15))), once, twice
        for found, one in zip((value, single, double), expected, strict=True):
            assert found[row] == pytest.approx(one * factors, abs=1e-13)


@pytest.mark.parametrize("half", [(False, False), (True, False), (False, True), (True, True)])
def test_derivatives_at_nodes_and_middles_are_scipys(half):
    """Values, first and second derivatives along both axes, in cells of 0.5 and 0.25: to rounding."""
    spacing = (0.5, 0.25)
    x, y = (np.random.default_rng(seed).normal(size=7) for seed in (5, 6))
    made = np.multiply.outer(x, y)
    for i in range(3):
        for j in range(3):
            found = projection_splines.at_places(made, i, j, spacing, half)
            expected = []
            for coefficients, order, h, middle in ((x, i, spacing[0], half[0]), (y, j, spacing[1], half[1])):
                places = np.arange(4) + 0.5 if middle else np.arange(4.0 + (not middle))
                spline = scipys(coefficients)
                if not middle:
                    places[-1] = 4.0 - 1e-12
                expected.append(spline(places, nu=order) / h**order)
            np.testing.assert_allclose(found, np.multiply.outer(*expected), atol=2e-9)
