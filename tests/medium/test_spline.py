"""The interpolants of a uniform grid, axis by axis: weights, nodes, continuity, exactness, and no overshoot."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerokernels.medium import spline
from aerokernels.medium.grid import UniformGrid


def grid(samples, interpolation: str, even: bool = False, spacing=None, origin=None) -> UniformGrid:
    """A grid whose potential is `samples`: ambient index 1, contrast sqrt(1 + 2 s) - 1."""
    samples = np.asarray(samples, dtype=np.float64)
    dimension = samples.ndim
    origin = np.zeros(dimension) if origin is None else origin
    spacing = np.ones(dimension) if spacing is None else spacing
    return UniformGrid(np.sqrt(1.0 + 2.0 * samples) - 1.0, origin, spacing, interpolation, even, 1.0)


def nodes(g: UniformGrid) -> np.ndarray:
    axes = [o + s * np.arange(n) for o, s, n in zip(g.origin, g.spacing, g.shape, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


@pytest.mark.parametrize("interpolation", spline.INTERPOLATIONS)
@pytest.mark.parametrize("shape", [(2, 2), (2, 7), (3, 3), (3, 4), (4, 5), (9, 6), (2, 3, 4), (5, 4, 6)])
@pytest.mark.parametrize("even", [False, True])
def test_nodes_are_met(interpolation, shape, even):
    """Whatever the number of nodes, two and three included; rounding only, of numbers up to 1."""
    samples = np.random.default_rng(sum(shape)).uniform(-0.1, 1.0, shape)
    g = grid(samples, interpolation, even)
    assert np.abs(g.evaluate_potential(nodes(g))[0] - samples.ravel()).max() < 1e-13


@pytest.mark.parametrize("shape", [(6, 7), (4, 4), (4, 6, 5)])
def test_cubic_reproduces_cubics_up_to_the_faces(shape):
    """A product of cubics along each axis is met, value and gradient, at faces and corners too; rounding only."""
    rng = np.random.default_rng(7)
    polynomials = [np.polynomial.Polynomial(rng.uniform(-1.0, 1.0, 4) / [1, 2, 4, 8]) for _ in shape]
    spacing, origin = np.array([0.5, 0.3, 0.4])[: len(shape)], np.array([-1.0, 0.2, -0.4])[: len(shape)]

    def exact(points):
        return np.prod([p(x) for p, x in zip(polynomials, points.T, strict=True)], axis=0)

    # Contrasts are stored, of indices near 1: a potential of up to 0.2.
    places = np.stack(np.meshgrid(*[o + s * np.arange(n) for o, s, n in zip(origin, spacing, shape, strict=True)],
                                  indexing="ij"), axis=-1)  # fmt: skip
    scale = 0.2 / np.abs(exact(places.reshape(-1, len(shape)))).max()
    g = grid(scale * exact(places.reshape(-1, len(shape))).reshape(shape), "cubic", spacing=spacing, origin=origin)
    points = np.vstack([rng.uniform(g.low, g.high, (300, len(shape))), list(product(*zip(g.low, g.high, strict=True)))])
    value, gradient = g.evaluate_potential(points)
    assert np.abs(value - scale * exact(points)).max() < 1e-14
    for axis in range(len(shape)):
        factors = [
            p.deriv()(x) if a == axis else p(x) for a, (p, x) in enumerate(zip(polynomials, points.T, strict=True))
        ]
        assert np.abs(gradient[:, axis] - scale * np.prod(factors, axis=0)).max() < 1e-13


@pytest.mark.parametrize(("count", "degree"), [(2, 1), (3, 2), (4, 3)])
def test_cubic_on_few_nodes_carries_the_polynomial_they_can(count, degree):
    x = np.arange(count)
    g = grid(0.01 * (1.0 + x[:, None] ** degree) * np.ones(2), "cubic")
    u = np.linspace(0.0, count - 1.0, 23)
    value = g.evaluate_potential(np.stack([u, 0.3 + 0.0 * u], axis=1))[0]
    assert value == pytest.approx(0.01 * (1.0 + u**degree), abs=1e-15)


@pytest.mark.parametrize("count", [3, 4, 5, 9])
def test_an_even_axis_reproduces_even_polynomials(count):
    """On [r, z] with mirror symmetry: s = 1 + r^2 and cubic in z; the slope at r = 0 is exactly nil."""
    r, z = np.meshgrid(np.arange(count) / (count - 1.0), np.arange(6) / 5.0, indexing="ij")
    g = grid(0.02 * (1.0 + r**2) * (1.0 - z + z**3), "cubic", even=True, spacing=(1.0 / (count - 1), 0.2))
    points = np.random.default_rng(1).uniform(0.0, 1.0, (200, 2))
    points[:20, 0], points[20:40, 0] = 0.0, 1.0
    value, gradient = g.evaluate_potential(points)
    u, v = points.T
    assert value == pytest.approx(0.02 * (1.0 + u**2) * (1.0 - v + v**3), abs=1e-15)
    assert gradient[:, 0] == pytest.approx(0.04 * u * (1.0 - v + v**3), abs=1e-14)


def one_sided_second_derivative(g: UniformGrid, axis: int, node: int, side: int, other: float) -> float:
    """In a cell the slope is a quadratic: its derivative at the node from three places in the cell, exactly."""
    place = node + side * np.array([1e-9, 0.25, 0.5])
    points = np.full((3, 2), other)
    points[:, axis] = place
    slope = g.evaluate_potential(points)[1][:, axis]
    return float(np.polynomial.polynomial.polyfit(place - node, slope, 2)[1])


@pytest.mark.parametrize("axis", [0, 1])
def test_cubic_is_twice_continuously_differentiable(axis):
    """The second derivative from the left and from the right of every inner node agree; noise as data."""
    g = grid(np.random.default_rng(3).uniform(0.0, 0.1, (8, 9)), "cubic")
    for node in range(1, g.shape[axis] - 1):
        left, right = (one_sided_second_derivative(g, axis, node, side, 2.3) for side in (-1, 1))
        assert abs(left - right) < 1e-7 and abs(left) > 1e-3


@given(
    shape=st.one_of(st.tuples(*[st.integers(2, 7)] * 2), st.tuples(*[st.integers(2, 5)] * 3)),
    kind=st.sampled_from(["noise", "steps", "spike", "ramp", "two levels"]),
    even=st.booleans(),
    seed=st.integers(0, 2**31),
)
@settings(max_examples=120, deadline=None)
def test_monotone_stays_within_each_cells_corners(shape, kind, even, seed):
    """The value never leaves the range of the 4 or 8 corners of its cell; rounding 1e-15."""
    rng = np.random.default_rng(seed)
    samples = {
        "noise": lambda: rng.uniform(-0.1, 0.1, shape),
        "steps": lambda: (
            0.1
            * np.sign(
                np.add.reduce(np.indices(shape) * rng.uniform(-1, 1, len(shape)).reshape(-1, *[1] * len(shape))) - 0.5
            )
        ),
        "spike": lambda: 0.1 * (np.arange(np.prod(shape)).reshape(shape) == rng.integers(np.prod(shape))),
        "ramp": lambda: np.sort(rng.uniform(0.0, 0.1, shape), axis=rng.integers(len(shape))),
        "two levels": lambda: 0.1 * rng.integers(0, 2, shape),
    }[kind]()
    g = grid(samples, "monotone", even)
    potential = g.samples * (1.0 + 0.5 * g.samples)
    points = rng.uniform(0.0, np.array(shape) - 1.0, (200, len(shape)))
    value = g.evaluate_potential(points)[0]
    cell = np.minimum(points.astype(int), np.array(shape) - 2)
    corners = [potential[tuple((cell + offset).T)] for offset in product((0, 1), repeat=len(shape))]
    assert (value >= np.min(corners, axis=0) - 1e-15).all()
    assert (value <= np.max(corners, axis=0) + 1e-15).all()
