"""Weights of pixels and the stencils behind them, beside polynomials and their integrals."""

import numpy as np
import pytest

from aerokernels import Disc
from aerokernels.pupils import Rectangle
from aerokernels.wavefront.pixel_errors import _steps_at_extremes
from aerokernels.wavefront.pixel_weights import derivative_weights, exact_weights


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


@pytest.mark.parametrize("count", [8, 16])
def test_means_over_a_rectangle_are_exact_to_second_order(count):
    """A rectangle that ends on quarters of pixels: the mean of parabolas over it, and over all pixels without it."""
    pixel = 1e-3 / count
    sides = np.array([0.5 * pixel * (count - 3), 0.5 * pixel * (count - 0.5)])
    pupil = Rectangle(2.0 * sides[0], 2.0 * sides[1])
    edges = pixel * (np.arange(count + 1) - 0.5 * count)
    weight = pupil.coverage(edges, edges)
    weight /= weight.sum()
    place = 0.5 * (edges[1:] + edges[:-1])
    y, x = np.meshgrid(place, place, indexing="ij")
    found = exact_weights(weight, pixel, pupil)
    assert found.sum() == pytest.approx(1.0, rel=1e-13)
    for values, mean in ((x, 0.0), (y, 0.0), (x**2, sides[0] ** 2 / 3.0), (y**2, sides[1] ** 2 / 3.0)):
        assert np.sum(found * values) == pytest.approx(mean, abs=1e-12 * pixel)
    whole = exact_weights(np.full((count, count), 1.0 / count**2), pixel, None)
    assert np.sum(whole * x**2) == pytest.approx((0.5e-3) ** 2 / 3.0, rel=1e-12)
    assert np.sum(whole * x) == pytest.approx(0.0, abs=1e-18)


def test_the_mean_over_a_disc_gains_an_order():
    """The mean of r^2 over a disc is half its radius squared; the pixels' own shares miss it by 0.13 pixels squared."""
    count, radius = 24, 1e-3
    pupil, pixel = Disc(radius), 2e-3 / count
    edges = pixel * (np.arange(count + 1) - 0.5 * count)
    weight = pupil.coverage(edges, edges)
    weight /= weight.sum()
    place = 0.5 * (edges[1:] + edges[:-1])
    square = place[:, None] ** 2 + place**2
    off = [abs(float(np.sum(one * square)) - 0.5 * radius**2) for one in (weight, exact_weights(weight, pixel, pupil))]
    assert 0.12 * pixel**2 < off[0] < 0.14 * pixel**2 and off[1] < 0.02 * pixel**2


def test_steps_beside_the_extremes():
    """The greatest step to a neighbour, corners and gaps included, of the greatest value and of the least, added."""
    nan = np.nan
    assert _steps_at_extremes(np.array([[9.0, 7.0, 0.0], [8.0, 6.5, 5.0], [nan, 4.0, -3.0]])) == 2.5 + 9.5
    assert _steps_at_extremes(np.array([[1.0, 2.0, 4.0], [3.0, 9.0, nan], [6.0, 5.0, 8.0]])) == 8.0 + 8.0
    assert _steps_at_extremes(np.array([[5.0, 4.0, 1.0], [4.0, 4.5, 2.0], [0.0, 3.0, 2.5]])) == 1.0 + 4.5
