"""Contrast on the points of another grid, and without a gradient: the interpolant of `contrast_at` itself."""

from itertools import product

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.medium.grid import contrast_on_axes, contrast_without_gradient
from tests.random_fields import mesh_field, uniform_field


def points_of(field: IndexField) -> list[np.ndarray]:
    """Along each axis of the grid: both ends, a node, places between, and outside by 1e-9 of the box and by more."""
    low, high = field.samples.low, field.samples.high
    shares = np.array([1.0, 0.0, 0.5, 0.137, 0.73, 0.9931, 1.0 + 1e-9, -1e-9, 1.2])
    return [a + (b - a) * shares for a, b in zip(low, high, strict=True)]


@pytest.mark.parametrize("interpolation", ["cubic", "linear", "monotone"])
@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_on_axes_and_without_a_gradient_it_is_the_same_interpolant(geometry, interpolation):
    """A contrast up to 0.3 where the ambient index is 1.2: 1e-14, and nothing outside the box."""
    field = uniform_field(geometry, interpolation, amplitude=0.3, ambient=1.2)
    axes = points_of(field)
    found = contrast_on_axes(field.samples, axes)
    local = np.array(list(product(*axes)))
    places = local if geometry == "volume" else np.insert(local, 0, 0.0, axis=1)
    if geometry == "axisymmetric":
        places[:, :2] = np.outer(local[:, 0], [0.6, 0.8])
    expected = np.asarray(field.contrast_at(places))
    assert 0.02 < np.abs(expected).max()
    keep = local[:, 0] >= 0.0 if geometry == "axisymmetric" else np.full(len(local), True)
    np.testing.assert_allclose(found.ravel()[keep], expected[keep], atol=1e-14)
    np.testing.assert_allclose(contrast_without_gradient(field, places), expected, atol=1e-14)


def test_of_a_mesh_it_is_contrast_at():
    """A mesh goes the way of `contrast_at`."""
    field = mesh_field()
    places = np.array([[0.0, 0.3e-3, 1e-3], [1.0, -0.5e-3, 2e-3]])
    np.testing.assert_array_equal(contrast_without_gradient(field, places), field.contrast_at(places))
