"""Derivatives of maps from the neighbours of each pixel, beside polynomials."""

import numpy as np
import pytest

from aerokernels.wavefront.stencils import derivative_weights


@pytest.mark.parametrize("axis", [0, 1])
def test_derivatives_are_those_of_parabolas(axis):
    """Runs of three pixels and more have both derivatives of a parabola, of two the slope of a line, one alone none."""
    random = np.random.default_rng(2)
    runs = np.array([1, 1, 1, 0, 1, 1, 0, 1, 0, 0, 1, 1, 1, 1, 1, 0, 1, 1, 1, 1], dtype=bool)
    long = np.array([1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 0, 1, 1, 1, 1], dtype=bool)
    pair = np.array([0, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0], dtype=bool)
    first, second = random.normal(size=(2, 20))
    x = np.arange(20.0)
    lit = runs[:, None] & np.ones(2, dtype=bool)

    def weights(moment, other):
        turned = [np.repeat(np.where(runs, one, 0.0)[:, None], 2, axis=1) for one in (moment, other)]
        if axis == 1:
            return derivative_weights(lit.T, turned[0].T, turned[1].T, 1).T
        return derivative_weights(lit, *turned, 0)

    for a, b, c in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.3, -2.0, 0.7)):
        parabola, slope = a + b * x + c * x**2, b + 2.0 * c * x
        for pixel in np.flatnonzero(runs):
            alone = np.where(x == pixel, first, 0.0), np.where(x == pixel, second, 0.0)
            found = parabola @ weights(*alone)
            if long[pixel]:
                assert found == pytest.approx([first[pixel] * slope[pixel] + second[pixel] * c] * 2, abs=1e-11)
            elif pair[pixel]:
                assert found == pytest.approx([first[pixel] * (parabola[5] - parabola[4])] * 2, abs=1e-11)
            else:
                assert not weights(*alone).any()
