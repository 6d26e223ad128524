"""Backgrounds, cameras and errors of displacements by hand: pixel by pixel, dot by dot."""

import math

import numpy as np
import pytest

from aerokernels import Camera, Disc, DotPattern
from aerokernels.imaging.camera import rows_and_columns
from aerokernels.imaging.dots import Background, _box
from aerokernels.imaging.render import hat
from aerokernels.imaging.shift import aperture
from aerokernels.imaging.through import filled


def test_a_camera_by_the_lens_equation():
    """Distances of pixels in the scene, tangents about the middle, unit vectors along them."""
    pupil = Disc(4e-3, (1e-3, 2e-3, 3e-3), (0.1, -0.2, 1.0))
    camera = Camera(pupil, 0.05, 4e-6, (3, 4), distance=2.0, focus=1.5)
    image = 1.0 / (1.0 / 0.05 - 1.0 / 1.5)
    assert camera.image_distance == pytest.approx(image) and camera.pixel_tangent == pytest.approx(4e-6 / image)
    assert camera.scene_pixel == pytest.approx(2.0 * 4e-6 / image) and camera.focus_distance == 1.5
    x, y = camera.tangents((3, 4))
    np.testing.assert_allclose(x, camera.pixel_tangent * np.array([-1.5, -0.5, 0.5, 1.5]))
    np.testing.assert_allclose(y, camera.pixel_tangent * np.array([-1.0, 0.0, 1.0]))
    found = camera.directions(np.array([0.1, -0.3]), np.array([0.2, 0.05]))
    for one, (a, b) in zip(found, ((0.1, 0.2), (-0.3, 0.05)), strict=True):
        way = a * pupil.axes[0] + b * pupil.axes[1] + pupil.normal
        np.testing.assert_allclose(one, way / np.linalg.norm(way))
    np.testing.assert_allclose(camera.across(found), found @ np.array(pupil.axes).T)
    assert Camera(pupil, 0.05, 4e-6).focus_distance == math.inf and Camera(pupil, 0.05, 4e-6).image_distance == 0.05
    with pytest.raises(ValueError, match="beyond the focal length"):
        Camera(pupil, 0.05, 4e-6, focus=0.05)
    assert rows_and_columns(7, "n") == (7, 7) and rows_and_columns((2, 3), "n") == (2, 3)
    assert rows_and_columns((10_000, 10_000), "n") == (10_000, 10_000)
    for wrong in (0, (1, 0), 1.5, (1, 2, 3), (10_000, 10_001)):
        with pytest.raises(ValueError, match="n must be|pixels are more"):  # noqa: RUF043
            rows_and_columns(wrong, "n")


@pytest.mark.parametrize("sample", [0.25, 0.4, 0.6])
def test_pixels_average_the_squares_of_a_fine_picture(sample: float):
    """Overlaps of a pixel of side 1 with squares of side `sample`, the border's squares going on outside."""
    draw = np.random.default_rng(1)
    brightness = draw.uniform(size=(9, 12))
    background = Background(brightness, sample, squares=True)
    prepared = background.prepared()
    rows, columns = draw.uniform(-2.0, 2.0, 20) * 9 * sample / 2.0, draw.uniform(-1.2, 1.2, 20) * 12 * sample / 2.0
    found = background.seen(prepared, rows, columns)
    reach = math.ceil(1.0 / sample) + 1
    for row, column, value in zip(rows, columns, found, strict=True):
        shares = []
        for place, count in ((row, 9), (column, 12)):
            limit = 0.5 * count * sample + reach * sample - 0.5
            place = min(max(place, -limit), limit)
            number = np.arange(-60, count + 60)
            low = (number - 0.5 * count) * sample
            overlap = np.clip(np.minimum(low + sample, place + 0.5) - np.maximum(low, place - 0.5), 0.0, None)
            share = np.zeros(count)
            np.add.at(share, np.clip(number, 0, count - 1), overlap)
            shares.append(share)
        expected = float(shares[0] @ brightness @ shares[1])
        assert value == pytest.approx(np.clip(expected, brightness.min(), brightness.max()), abs=1e-9)


def test_weights_of_a_mean_over_a_width():
    """Whole samples in the middle, the ends by their share."""
    for width, expected in (
        (1.0, [1.0]),
        (2.0, [0.25, 0.5, 0.25]),
        (2.5, [0.3, 0.4, 0.3]),
        (3.0, [1, 1, 1]),
        (4.4, [0.7, 1, 1, 1, 0.7]),
    ):
        np.testing.assert_allclose(_box(width), np.array(expected) / np.sum(expected), atol=1e-15)
    assert _box(0.6).tolist() == [1.0]


@pytest.mark.parametrize("sample", [0.5, 1.0, 2.5])
def test_a_smooth_picture_is_interpolated_after_its_mean(sample: float):
    """A plane is kept by means and by splines; values stay between the darkest and the brightest."""
    y, x = np.mgrid[:40, :50].astype(float)
    plane = 0.5 + 0.01 * (y - 19.5) * sample - 0.004 * (x - 24.5) * sample
    background = Background(plane, sample)
    prepared = background.prepared()
    rows, columns = np.array([0.3, -3.2, 2.7]), np.array([-2.4, 0.6, 4.1])
    np.testing.assert_allclose(background.seen(prepared, rows, columns), 0.5 + 0.01 * rows - 0.004 * columns, atol=1e-6)
    edge = Background((x > 25).astype(float), sample)
    seen = edge.seen(edge.prepared(), np.zeros(200), np.linspace(-3.0, 3.0, 200))
    assert seen.min() >= 0.0 and seen.max() <= 1.0
    camera = Camera(Disc(1e-3), 0.05, 4e-6, 8, distance=1.0)
    for pixel, squares in ((camera.scene_pixel / 1.51, True), (camera.scene_pixel / 1.49, False)):
        made = Background.of_scene(plane, pixel, camera)
        assert made.squares is squares and made.sample == pytest.approx(pixel / camera.scene_pixel)
    for wrong in (np.zeros((1, 5)), np.zeros(5), np.full((3, 3), np.nan)):
        with pytest.raises(ValueError, match="background must be"):
            Background.of_scene(wrong, 1e-5, camera)


def test_dots_are_gaussians_that_do_not_exceed_white():
    """1 - prod (1 - 0.98 exp(-2 r^2 / R^2)) over all dots; their number by the density."""
    pattern = DotPattern(diameter=3.0, density=0.2, seed=5)
    made = pattern.background((6, 8), 1.3)
    rows, columns = math.ceil(2.0 * 8.6), math.ceil(2.0 * 10.6)
    assert made.brightness.shape == (rows, columns) and made.sample == 0.5 and not made.squares
    count = round(0.2 * rows * columns / 4.0)
    draw = np.random.default_rng(5)
    y, x = draw.random(count) * rows, draw.random(count) * columns
    dark = np.ones((rows, columns))
    for a, b in zip(y, x, strict=True):
        square = (np.arange(rows)[:, None] - a) ** 2 + (np.arange(columns) - b) ** 2
        dark *= 1.0 - 0.98 * np.exp(-2.0 * square / 3.0**2)
    np.testing.assert_allclose(made.brightness, 1.0 - dark, atol=6e-4)  # dots end at two radii, exp(-8)
    assert DotPattern(density=1e-9).background((4, 4), 0.0).brightness.max() > 0.3
    with pytest.raises(ValueError, match="below one pixel"):
        DotPattern(diameter=0.99)
    assert DotPattern(diameter=1.0).diameter == 1.0


def test_points_of_an_aperture_have_the_square_of_its_transmission():
    """Gauss points about the middle; one point alone is the middle."""
    camera = Camera(Disc(2e-3, (0.1, 0.2, 0.3), (0.2, 0.1, 1.0)), 0.05, 4e-6, 4)
    points, weights = aperture(camera, 16)
    assert weights.sum() == pytest.approx(1.0) and weights @ points == pytest.approx([0.0, 0.0], abs=1e-18)
    assert weights @ (points**2).sum(axis=1) == pytest.approx(0.5 * 4e-6)
    single = aperture(camera, 1)
    assert single[0].tolist() == [[0.0, 0.0]] and single[1].tolist() == [1.0]


def test_weights_of_nodes_add_up_to_one():
    nodes = np.array([2, 5, 9])
    total = np.zeros(12)
    for index in range(3):
        pixels, weight = hat(nodes, index, 12)
        np.testing.assert_allclose(weight, np.interp(pixels, nodes, np.eye(3)[index]))
        total[pixels] += weight
    np.testing.assert_allclose(total, 1.0)
    assert hat(nodes, 1, 12)[0].tolist() == [3, 4, 5, 6, 7, 8] and hat(nodes, 0, 12)[0].tolist() == [0, 1, 2, 3, 4]
    shift = np.zeros((4, 5, 2))
    shift[1, 2] = np.nan
    shift[0, 0] = (1.0, 2.0)
    known, dark = filled(shift)
    assert np.isfinite(known).all() and dark.sum() == 1 and dark[1, 2]
    np.testing.assert_array_equal(known[~dark], shift[~dark])
