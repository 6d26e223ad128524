"""The contrast on a uniform grid: fitted orders, gradient as derivative, eq 5, refusals."""

import numpy as np
import pytest

from aerokernels.medium.grid import UniformGrid, check_finite
from tests.fitted_order import fitted_order


def smooth(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A contrast with no symmetry, and its gradient, on [0, 1]^d."""
    rate = np.array([2.0, -3.0, 1.5])[: points.shape[1]]
    phase = points @ rate + 0.4
    value = 0.05 * np.sin(phase) * np.exp(0.3 * points[:, 0])
    gradient = 0.05 * np.exp(0.3 * points[:, 0])[:, None] * np.cos(phase)[:, None] * rate
    gradient[:, 0] += 0.3 * value
    return value, gradient


def sampled(count: int, dimension: int, interpolation: str, even: bool = False, function=smooth) -> UniformGrid:
    axes = [np.linspace(0.0, 1.0, count)] * dimension
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    values = function(places.reshape(-1, dimension))[0].reshape(places.shape[:-1])
    return UniformGrid(values, np.zeros(dimension), np.full(dimension, 1.0 / (count - 1)), interpolation, even, 1.2)


def errors(g: UniformGrid, function=smooth) -> tuple[float, float]:
    """Greatest error of value and of gradient over scattered points, faces included."""
    points = np.random.default_rng(0).uniform(0.0, 1.0, (4000, len(g.shape)))
    points[:200, 0], points[200:400, -1] = 0.0, 1.0
    value, gradient = g.evaluate(points)
    exact, slope = function(points)
    return np.abs(value - exact).max(), np.abs(gradient - slope).max()


@pytest.mark.parametrize(
    ("interpolation", "dimension", "counts", "value_order", "gradient_order"),
    [
        ("cubic", 2, (17, 33, 65, 129), 4.0, 3.0),
        ("cubic", 3, (9, 17, 33), 4.0, 3.0),
        ("linear", 2, (17, 33, 65, 129), 2.0, 1.0),
        ("linear", 3, (9, 17, 33), 2.0, 1.0),
    ],
)
def test_orders(interpolation, dimension, counts, value_order, gradient_order):
    """A smooth contrast in ambient index 1.2; orders of the greatest error fitted over halved spacings, +-0.2."""
    found = np.array([errors(sampled(count, dimension, interpolation)) for count in counts])
    spacings = 1.0 / (np.array(counts) - 1.0)
    assert abs(fitted_order(spacings, found[:, 0]) - value_order) < 0.2
    assert abs(fitted_order(spacings, found[:, 1]) - gradient_order) < 0.2


def test_a_quadratic_square_of_the_index_is_exact_in_a_strong_medium():
    """n^2 = 2.25 (1 - 0.09 (y^2 + z^2)): the potential is a parabola, all is exact to rounding."""
    axis = np.linspace(-1.0, 1.0, 9)
    y, z = np.meshgrid(axis, axis, indexing="ij")

    def index(y, z):
        return np.sqrt(2.25 * (1.0 - 0.09 * (y**2 + z**2)))

    g = UniformGrid(index(y, z) - 1.0, [-1.0, -1.0], [0.25, 0.25], "cubic", False, 1.0)
    points = np.random.default_rng(2).uniform(-1.0, 1.0, (500, 2))
    value, gradient = g.evaluate(points)
    n = index(*points.T)
    assert np.abs(value - (n - 1.0)).max() < 1e-14
    assert np.abs(gradient - (-2.25 * 0.09 / n)[:, None] * points).max() < 1e-13


def test_a_contrast_of_2_to_the_minus_30_survives():
    """The precision trap: on ambient index 1 + 2^-30 a contrast of 2^-30 comes back to 1e-15 of itself."""
    g = UniformGrid(np.full((5, 5), 2.0**-30), np.zeros(2), np.ones(2), "cubic", False, 1.0 + 2.0**-30)
    value, gradient = g.evaluate(np.random.default_rng(0).uniform(0.0, 4.0, (50, 2)))
    assert np.abs(value / 2.0**-30 - 1.0).max() < 1e-14 and np.abs(gradient).max() < 1e-23


def test_eq_5_takes_the_difference_over_the_corners_of_a_cell():
    """Reading 5: 2 x 3 cells of 1 x 4, l = 2; one corner at 1e-4 halves the step of the cells that share it."""
    samples = np.zeros((3, 4))
    samples[0, 0], samples[2, 2] = 1e-4, 5e-2
    g = UniformGrid(samples, [0, 0], [1.0, 4.0], "linear", False, 1.0)
    assert g.paper_step == pytest.approx(np.array([[1.0, 2.0, 2.0], [2.0, 0.1, 0.1]]), rel=1e-15)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"origin": [0.0]}, r"one entry per array axis \(2\), got 1 and 2"),
        ({"spacing": [1.0, 1.0, 1.0]}, r"one entry per array axis \(2\), got 2 and 3"),
        ({"origin": [0.0, np.inf]}, "origin must be finite"),
        ({"spacing": [1.0, 0.0]}, "spacing must be positive.*0.0"),
        ({"spacing": [1.0, -1.0]}, "spacing must be positive.*-1.0"),
        ({"spacing": [1.0, np.nan]}, "spacing must be positive and finite"),
        ({"samples": np.zeros((1, 5))}, r"at least two nodes, got shape \(1, 5\)"),
        ({"interpolation": "quintic"}, "'quintic' is not known: choose one of cubic, linear, monotone"),
    ],
)
def test_what_is_refused(change, message):
    good = {"samples": np.zeros((3, 4)), "origin": [0, 0], "spacing": [1, 1], "interpolation": "cubic"}
    with pytest.raises(ValueError, match=message):
        UniformGrid(**{**good, **change}, even_first_axis=False, ambient_index=1.0)


def test_samples_that_are_not_finite_are_counted_and_placed():
    samples = np.zeros((3, 4))
    samples[1, 2], samples[2, 0], samples[2, 3] = np.nan, np.inf, -np.inf
    with pytest.raises(ValueError, match=r"3 of 12 samples of the contrast are NaN or infinite.*\(1, 2\).*fill or cut"):
        check_finite(samples, "the contrast")
    check_finite(np.zeros(3), "nothing")
