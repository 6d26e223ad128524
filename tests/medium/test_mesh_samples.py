"""Interpolation on a mesh: bilinear, eq 6 (inverse distance) and eq 7 (node gradients)."""

import numpy as np
import pytest

from aerokernels import QuadMesh
from aerokernels.medium.mesh_samples import MESH_INTERPOLATIONS, MeshSamples, inverse_distance_weights
from tests.fitted_order import fitted_order


def curvilinear(count: int, geometry: str = "planar") -> QuadMesh:
    """A smoothly bent grid of count x count vertices, the same map at every count."""
    a, b = np.meshgrid(np.linspace(0.0, 1.0, count), np.linspace(0.0, 1.0, count), indexing="ij")
    first = 0.5 + a + 0.1 * np.sin(2.0 * b + a)
    second = b + 0.15 * np.cos(1.5 * a) * b + 0.1 * a
    return QuadMesh.structured(first, second, geometry)


def function(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    phase = points @ np.array([2.0, -1.5]) + 0.3
    return np.sin(phase), np.cos(phase)[:, None] * [2.0, -1.5]


def sampled(mesh: QuadMesh, interpolation: str, function=function) -> MeshSamples:
    return MeshSamples(mesh, function(mesh.vertices)[0], interpolation)


def inside(mesh: QuadMesh, count: int, seed: int = 0) -> np.ndarray:
    """Points inside the cells, away from edges by a hundredth of the cell."""
    rng = np.random.default_rng(seed)
    cell = rng.integers(0, len(mesh.cells), count)
    xi, eta = rng.uniform(0.01, 0.99, (2, count, 1))
    a, b, c, d = (mesh.corners[cell, k] for k in range(4))
    return (1 - xi) * (1 - eta) * a + xi * (1 - eta) * b + xi * eta * c + (1 - xi) * eta * d


@pytest.mark.parametrize("interpolation", [name for name in MESH_INTERPOLATIONS if name != "cells"])
def test_vertices_are_met(interpolation):
    """Exact at vertices, eq 6 too (its product form has no division by a distance); rounding 1e-12."""
    mesh = curvilinear(8)
    samples = sampled(mesh, interpolation)
    assert np.abs(samples.evaluate(mesh.vertices)[0] - samples.values).max() < 1e-12


@pytest.mark.parametrize("interpolation", ["bilinear", "bilinear-barron"])
def test_linear_fields_are_exact(interpolation):
    mesh = curvilinear(8)

    def linear(points):
        return 1.0 + points @ [2.0, -3.0], np.tile([2.0, -3.0], (len(points), 1))

    points = inside(mesh, 500)
    value, gradient = sampled(mesh, interpolation, linear).evaluate(points)
    assert np.abs(value - linear(points)[0]).max() < 1e-12
    assert np.abs(gradient - [2.0, -3.0]).max() < 1e-10


def test_inverse_distance_is_eq_6():
    """Where no distance is nil the product form is the printed one, sum(f_k / d_k) / sum(1 / d_k); rounding 1e-13."""
    mesh = curvilinear(5)
    points = inside(mesh, 200)
    corners = mesh.corners[mesh.locate(points)]
    distance = np.linalg.norm(points[:, None] - corners, axis=2)
    printed = (1.0 / distance) / (1.0 / distance).sum(axis=1, keepdims=True)
    assert np.abs(inverse_distance_weights(corners, points) - printed).max() < 1e-13


def test_bilinear_gradient_is_the_derivative_of_the_value():
    """Noise as data on a bent mesh; central differences of 1e-7 cells of 0.1. Truncation 1e-12, rounding 1e-7."""
    mesh = curvilinear(10)
    samples = MeshSamples(mesh, np.random.default_rng(1).uniform(-1.0, 1.0, len(mesh.vertices)), "bilinear")
    points = inside(mesh, 300)
    gradient = samples.evaluate(points)[1]
    for axis in (0, 1):
        step = 1e-7 * np.eye(2)[axis]
        difference = (samples.evaluate(points + step)[0] - samples.evaluate(points - step)[0]) / 2e-7
        assert np.abs(difference - gradient[:, axis]).max() < 1e-6


@pytest.mark.parametrize(
    ("interpolation", "value_order", "gradient_order"), [("bilinear", 2.0, 1.0), ("bilinear-barron", 2.0, 2.0)]
)
def test_orders(interpolation, value_order, gradient_order):
    """Greatest error on a bent mesh, fitted over 17 to 129 vertices a side, +-0.2."""
    counts = (17, 33, 65, 129)
    value, gradient = [], []
    for count in counts:
        mesh = curvilinear(count)
        points = inside(mesh, 4000)
        found, exact = sampled(mesh, interpolation).evaluate(points), function(points)
        value.append(np.abs(found[0] - exact[0]).max())
        gradient.append(np.abs(found[1] - exact[1]).max())
    assert abs(fitted_order(1.0 / (np.array(counts) - 1.0), value) - value_order) < 0.2
    assert abs(fitted_order(1.0 / (np.array(counts) - 1.0), gradient) - gradient_order) < 0.2


def test_eq_5_on_a_mesh():
    """Reading 5: the difference is over the vertices of the cell; l = sqrt(a b) with a = 1, b = 4."""
    mesh = QuadMesh.structured(*np.meshgrid([0.0, 1.0, 2.0], [0.0, 4.0], indexing="ij"))
    samples = MeshSamples(mesh, np.array([0.0, 0.0, 5e-5, 0.0, 5e-4, 0.0]), "bilinear")
    assert samples.paper_step == pytest.approx([1.0, 0.4], rel=1e-15)


def test_unknown_names_are_answered_with_the_known_ones():
    with pytest.raises(ValueError, match=r"'cubic' is not known on a mesh.*bilinear, bilinear-barron, idw"):
        sampled(curvilinear(5), "cubic")
