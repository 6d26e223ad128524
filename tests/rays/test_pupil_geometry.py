"""Extents, areas and frames of pupils of any size."""

import math

import numpy as np
import pytest

from aerokernels import Mask, Polygon, Rectangle
from aerokernels.pupils.base import transverse_axes, transverse_frames


def test_frames_of_many_directions_are_those_of_each():
    """`transverse_frames` beside `transverse_axes`, close to y too, where another helper is taken: to rounding."""
    normals = np.random.default_rng(6).normal(size=(60, 3)) * [1.0, 3.0, 1.0]
    normals = np.concatenate([normals, np.eye(3), -np.eye(3)])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    expected = np.array([transverse_axes(normal) for normal in normals])
    np.testing.assert_allclose(transverse_frames(normals), expected, atol=1e-15)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e4])
def test_what_a_polygon_encloses_is_measured_by_its_size(size):
    """A square of any size is one, and corners on a line to rounding are none; places do not matter."""
    square = size * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) + 3.0 * size
    pupil = Polygon(square)
    assert pupil.area == pytest.approx(size**2, rel=1e-12)
    assert pupil.half_extent == pytest.approx((4.0 * size, 4.0 * size))
    assert pupil.reach == pytest.approx(4.0 * math.sqrt(2.0) * size)
    with pytest.raises(ValueError, match="enclose nothing"):
        Polygon(size * np.array([[0.0, 0.0], [0.5, 0.5 + 1e-13], [1.0, 1.0]]))


def test_sides_of_pixels_may_differ():
    """A mask of 3 rows and 5 columns of 1 by 2 mm: half extents along x and y, area by weights, corners' distance."""
    mask = Mask(np.full((3, 5), 0.5), (1e-3, 2e-3))
    assert mask.half_extent == pytest.approx((2.5e-3, 3e-3))
    assert mask.reach == pytest.approx(np.hypot(2.5e-3, 3e-3))
    box = Rectangle(5e-3, 6e-3)
    assert box.half_extent == pytest.approx((2.5e-3, 3e-3)) and box.area == pytest.approx(30e-6)


def test_a_ring_that_names_its_first_corner_again_is_the_polygon():
    """As closed rings of other software do; edges of no length were taken to meet their neighbours."""
    corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    for ring in ([*corners, corners[0]], [corners[0], *corners, corners[-1]]):
        assert np.array_equal(Polygon(ring).vertices, corners)
    with pytest.raises(ValueError, match="enclose nothing"):
        Polygon([[1.0, 2.0]] * 4)
