"""Parts of errors, pictures and flows by exact answers."""

import math

import numpy as np
import pytest

from aerokernels import Camera, Disc, DotPattern, IndexField, RayBundle, trace
from aerokernels.flow.conical_field import _divided, _gauss, bell, cell_averages
from aerokernels.medium import Body
from aerokernels.tracing.blocks import greatest_around, over_lines


def test_a_wall_that_begins_on_the_axis_is_a_wall():
    """A double cone: both sides are surface, the line along the axis that closes the profile is none."""
    body = Body(np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 1.0]]), "axisymmetric")
    for start, end in (body.surface, body.walls):
        assert len(start) == 2
        assert sorted(np.hypot(*(end - start).T)) == pytest.approx([math.sqrt(2.0)] * 2)
    ring = Body(np.array([[1.0, -1.0], [2.0, 0.0], [1.0, 1.0]]), "axisymmetric")
    assert len(ring.surface[0]) == len(ring.walls[0]) == 3
    flat = Body(np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 1.0]]), "planar")
    assert len(flat.surface[0]) == len(flat.walls[0]) == 3


def test_averages_over_boxes_of_a_cone():
    """By Gauss points, against a hundred by a hundred midpoints; and boxes that are divided are the boxes."""
    box = np.array([[0.2, 0.5, -1.4, -1.0], [0.0, 0.3, -0.9, -0.2]])
    angle = lambda polar: 1.0 + np.sin(3.0 * polar)  # noqa: E731
    share = (np.arange(100) + 0.5) / 100
    for row, average in zip(box, _gauss(angle, box, 8), strict=True):
        r, z = row[0] + (row[1] - row[0]) * share, row[2] + (row[3] - row[2]) * share
        expected = angle(np.arctan2(r[:, None], -z)).mean()
        assert average == pytest.approx(expected, rel=2e-5)
    parts = _divided(box, 4)
    area = (parts[:, 1] - parts[:, 0]) * (parts[:, 3] - parts[:, 2])
    whole = (box[:, 1] - box[:, 0]) * (box[:, 3] - box[:, 2])
    np.testing.assert_allclose(area.reshape(2, 16).sum(axis=1), whole, rtol=1e-12)
    finer = (_gauss(angle, parts, 8) * area).reshape(2, 16).sum(axis=1) / whole
    np.testing.assert_allclose(finer, _gauss(angle, box, 8), rtol=1e-5)


def test_cell_averages_of_a_uniform_cone_are_its_share_of_the_cells():
    """Contrast 1 behind a shock of 30 degrees: the average is the share of the cell behind it, by a fine lattice."""
    step, low, shape = np.array([0.05, 0.07]), -2.0, (24, 30)
    shock = math.radians(30.0)
    found = cell_averages(lambda polar: np.ones(np.shape(polar)), shock, shape, low, step)
    share = (np.arange(60) + 0.5) / 60 - 0.5
    for i, k in ((0, 3), (5, 12), (10, 9), (12, 11), (20, 1), (23, 29)):
        r = step[0] * (i + share)
        r = r[r > 0.0]
        z = low + step[1] * (k + share)
        expected = (np.arctan2(r[:, None], -z) < shock).mean()
        assert found[i, k] == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("axis", [0, 1])
def test_the_bell_keeps_cubics(axis: int):
    """Averages over half cells of x^3 - 2 x: sharpened node values are the cubic's but for a constant of none."""
    half = np.arange(-5.0, 24.0)  # numbers of half cells; node k lies in the middle of the (2 k)-th
    edges = 0.5 * (half - 0.5), 0.5 * (half + 0.5)
    integral = lambda x: 0.25 * x**4 - x**2  # noqa: E731
    averages = (integral(edges[1]) - integral(edges[0])) / 0.5
    flat = np.stack([averages] * 3, axis=1 - axis)
    nodes = bell(flat, axis, sharpen=True).take(0, axis=1 - axis)
    x = np.arange(len(nodes)) + 0.0
    shifted = x**3 - 2.0 * x
    offset = nodes - shifted
    np.testing.assert_allclose(np.diff(offset, 3), 0.0, atol=1e-9)
    assert len(np.unique(np.round(np.diff(nodes, 3), 9))) == 1 and np.diff(nodes, 3)[0] == pytest.approx(6.0)


def test_what_lies_about_a_place_and_along_lines():
    """Greatest within some places along an axis, and sums and greatest over whole lines, by brute force."""
    values = np.abs(np.random.default_rng(4).normal(size=(6, 7, 5)))
    for axis in range(3):
        for low, high in ((-1, 1), (0, 2), (-2, 0)):
            found = greatest_around(values, low, high, axis)
            moved, expected = np.moveaxis(found, axis, 0), np.moveaxis(values, axis, 0)
            for k in range(len(expected)):
                near = expected[max(k + low, 0) : k + high + 1]
                np.testing.assert_array_equal(moved[k], near.max(axis=0))
        np.testing.assert_allclose(over_lines(values, np.add)[axis], np.abs(values).sum(axis=axis), rtol=1e-12)
        np.testing.assert_array_equal(over_lines(values, np.maximum)[axis], np.abs(values).max(axis=axis))


def test_arrays_that_lie_in_memory_are_given_as_they_are():
    """Rays and results without a device: NumPy arrays, and no device."""
    rays = RayBundle([[0.0, 0.0, -1.0], [0.0, 1e-3, -1.0]], (0.0, 0.0, 1.0))
    assert rays.device is None
    for name in ("position", "direction"):
        assert rays.on_device(name) is rays.held(name)
        assert isinstance(rays.on_device(name), np.ndarray)
    field = IndexField.from_samples(
        np.full((9, 9), 1e-6), origin=(-0.01, 0.0), spacing=(2.5e-3, 2.5e-3), geometry="planar"
    )
    found = trace(field, rays, backend="reference", precision="float64")
    assert isinstance(found.on_device("opd"), np.ndarray)
    np.testing.assert_array_equal(found.on_device("opd"), found.opd)


def test_rays_of_pixels_are_unit_vectors_toward_them():
    """From a point of the aperture of a camera that looks aslant: pixel k lies at k times pixel over focal length."""
    normal = np.array([0.2, -0.1, 1.0]) / math.sqrt(1.05)
    camera = Camera(Disc(0.01, (1e-3, 2e-3, 3e-3), normal), 0.05, 1e-4, (4, 6))
    x, y = (axis.ravel() for axis in np.meshgrid(*camera.tangents((4, 6))))
    rays = camera.rays(np.array([2e-3, -3e-3]), x, y)
    np.testing.assert_allclose(np.linalg.norm(rays.direction, axis=1), 1.0, atol=1e-15)
    ahead = rays.direction @ normal
    places = [(rays.direction @ axis / ahead).reshape(4, 6) for axis in camera.pupil.axes]
    np.testing.assert_allclose(places[0], 2e-3 * (np.arange(6) - 2.5) * np.ones((4, 1)), atol=1e-15)
    np.testing.assert_allclose(places[1], 2e-3 * (np.arange(4)[:, None] - 1.5) * np.ones(6), atol=1e-15)


@pytest.mark.parametrize("name", ["diameter", "density"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_dots_without_size_or_number_are_refused(name: str, value: float):
    with pytest.raises(ValueError, match=name):
        DotPattern(**{name: value})
