"""Pupils, sampling of the disc, and ray bundles."""

from math import gamma

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerokernels import Disc, RayBundle
from aerokernels.rays import SAMPLINGS, as_unit_vector, as_vector, transverse_axes, unit_disc_samples

component = st.floats(-1e300, 1e300, allow_nan=False)
vector = st.tuples(component, component, component).filter(lambda v: max(map(abs, v)) > 1e-290)


# --- vectors ---------------------------------------------------------------------------------------------------------


@given(vector)
@settings(deadline=None)
def test_unit_vectors(value):
    """Length 1, same direction, for lengths from 1e-290 to 1e300; rounding 1e-15."""
    unit = as_unit_vector(value, "axis")
    assert abs(np.linalg.norm(unit) - 1.0) < 1e-15
    scaled = np.array(value) / np.abs(value).max()
    assert np.abs(np.cross(unit, scaled)).max() < 1e-15 and unit @ scaled > 0.0


@given(vector)
@settings(deadline=None)
def test_transverse_axes_complete_a_right_handed_frame(value):
    normal = as_unit_vector(value, "axis")
    first, second = transverse_axes(normal)
    frame = np.stack([first, second, normal])
    assert np.abs(frame @ frame.T - np.eye(3)).max() < 1e-14
    assert abs(np.linalg.det(frame) - 1.0) < 1e-14


@pytest.mark.parametrize("bad", [(1.0, 2.0), (1.0, 2.0, np.nan), (np.inf, 0.0, 0.0), 3.0, np.zeros((1, 3))])
def test_what_is_no_vector(bad):
    with pytest.raises(ValueError, match="axis must be three finite numbers"):
        as_vector(bad, "axis")


def test_a_zero_vector_has_no_direction():
    with pytest.raises(ValueError, match="axis must not be the zero vector"):
        as_unit_vector((0.0, 0.0, 0.0), "axis")


# --- sampling of the disc --------------------------------------------------------------------------------------------


def mean_of_monomial(a: int, b: int) -> float:
    """Mean of x^a y^b over the unit disc."""
    if a % 2 or b % 2:
        return 0.0
    return 2.0 / (a + b + 2) * gamma((a + 1) / 2) * gamma((b + 1) / 2) / (np.pi * gamma((a + b) / 2 + 1))


@given(count=st.integers(1, 3000), sampling=st.sampled_from(SAMPLINGS), seed=st.integers(0, 2**31))
@settings(max_examples=80, deadline=None)
def test_points_lie_in_the_disc_and_weights_sum_to_1(count, sampling, seed):
    points, weight = unit_disc_samples(count, sampling, seed)
    assert points.shape == (len(weight), 2) and (weight > 0.0).all()
    assert abs(weight.sum() - 1.0) < 1e-13
    assert (np.hypot(*points.T) <= 1.0 + 1e-15).all()
    if sampling in ("sobol", "random"):
        assert len(weight) == count and np.ptp(weight) == 0.0
    elif count >= 16:
        assert 0.7 * count <= len(weight) <= 1.4 * count


def test_gauss_is_exact_for_polynomials():
    """144 points: 6 radii (exact to degree 11 in r^2) by 24 angles: every monomial x^a y^b with a + b <= 22."""
    points, weight = unit_disc_samples(144, "gauss")
    assert len(weight) == 144
    x, y = points.T
    for a in range(23):
        for b in range(23 - a):
            assert abs(weight @ (x**a * y**b) - mean_of_monomial(a, b)) < 1e-15


def test_grid_is_even_and_symmetric():
    """Cells of 0.04: the rim is ragged by half a cell here and there, (0.04)^1.5 = 8e-3 at most of the mean of r^2."""
    points, weight = unit_disc_samples(2000, "grid")
    assert np.ptp(weight) == 0.0
    assert np.abs(weight @ points).max() < 1e-15
    assert abs(weight @ np.sum(points**2, axis=1) - 0.5) < 8e-3


@pytest.mark.parametrize("sampling", ["sobol", "random"])
def test_the_seed_decides(sampling):
    first, again, other = (unit_disc_samples(100, sampling, seed)[0] for seed in (1, 1, 2))
    assert np.array_equal(first, again) and not np.array_equal(first, other)


@pytest.mark.parametrize("count", [0, -3, 2.5, "many", None])
def test_counts_that_are_no_counts(count):
    with pytest.raises(ValueError, match="ray_count must be a whole number of at least 1"):
        Disc(1.0).sample(count)


def test_unknown_sampling_is_answered_with_the_known_ones():
    with pytest.raises(ValueError, match=r"'halton' is not known: choose one of sobol, gauss, grid, random"):
        Disc(1.0).sample(10, "halton")


# --- the pupil -------------------------------------------------------------------------------------------------------


@given(normal=vector, radius=st.floats(1e-6, 1e3), sampling=st.sampled_from(SAMPLINGS))
@settings(max_examples=50, deadline=None)
def test_samples_lie_in_the_pupil(normal, radius, sampling):
    """In its plane, within its radius, around its centre; rounding relative to radius and centre."""
    center = np.array([0.3, -0.2, 0.1])
    pupil = Disc(radius, center, normal)
    points, weight = pupil.sample(200, sampling)
    away = points - center
    slack = 1e-14 * (radius + 1.0)
    assert np.abs(away @ pupil.normal).max() < slack
    assert (np.linalg.norm(away, axis=1) <= radius + slack).all()
    assert len(points) == len(weight)


def test_area():
    assert Disc(2.0).area == pytest.approx(4.0 * np.pi, rel=1e-15)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0.0,), "radius of a Disc must be positive and finite, got 0.0"),
        ((-1.0,), "radius of a Disc must be positive and finite, got -1.0"),
        ((np.nan,), "radius of a Disc must be positive and finite, got nan"),
        ((1.0, (0.0, 0.0)), "Disc center must be three finite numbers"),
        ((1.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), "Disc normal must not be the zero vector"),
    ],
)
def test_what_is_no_pupil(arguments, message):
    with pytest.raises(ValueError, match=message):
        Disc(*arguments)


# --- bundles ---------------------------------------------------------------------------------------------------------


@given(directions=st.lists(vector, min_size=1, max_size=5))
@settings(deadline=None)
def test_directions_are_normalised(directions):
    rays = RayBundle(np.zeros((len(directions), 3)), directions)
    assert np.abs(np.linalg.norm(rays.direction, axis=1) - 1.0).max() < 1e-15
    assert rays.ray_count == len(rays) == len(directions)
    assert rays.weight == pytest.approx(np.full(len(rays), 1.0 / len(rays)))


def test_weights_are_normalised_and_arrays_are_copies():
    position = np.zeros((3, 3))
    rays = RayBundle(position, [0.0, 0.0, 2.0], [1.0, 2.0, 1.0])
    position[:] = 9.0
    assert rays.weight == pytest.approx([0.25, 0.5, 0.25], rel=1e-15)
    assert np.array_equal(rays.position, np.zeros((3, 3))) and np.array_equal(rays.direction, [[0, 0, 1]] * 3)
    with pytest.raises(ValueError, match="read-only"):
        rays.position[0] = 1.0


def test_slices():
    rays = RayBundle(np.arange(12.0).reshape(4, 3), np.eye(3)[[0, 1, 2, 0]], [1.0, 2.0, 3.0, 4.0])
    assert np.array_equal(rays[1:3].position, rays.position[1:3])
    assert rays[1:3].weight == pytest.approx([0.4, 0.6])
    assert rays[2].ray_count == 1 and rays[2].weight.tolist() == [1.0]
    assert np.array_equal(rays[np.array([True, False, False, True])].direction, [[1, 0, 0], [1, 0, 0]])


def test_collimated():
    """Along the pupil's normal, or along a direction of one's own, from the pupil's own sample."""
    pupil = Disc(2.0, (1.0, 2.0, 3.0), (0.0, 1.0, 1.0))
    points, weight = pupil.sample(100, "gauss")
    rays = RayBundle.collimated(pupil, 100, sampling="gauss")
    assert np.array_equal(rays.position, points) and rays.weight == pytest.approx(weight, rel=1e-14)
    assert np.abs(rays.direction - np.array([0.0, 1.0, 1.0]) / np.sqrt(2.0)).max() < 1e-15
    assert np.array_equal(RayBundle.collimated(pupil, 8, direction=(3.0, 0.0, 0.0)).direction, [[1.0, 0.0, 0.0]] * 8)
    assert RayBundle.collimated(pupil).ray_count == 1024


@pytest.mark.parametrize("half_angle", [1e-8, 0.3, 1.8, np.pi])
def test_divergent_is_uniform_in_solid_angle(half_angle):
    """Gauss weights are exact: mean of 1 - cos is sin^2(half_angle / 2), of its square 4/3 of that squared.

    In the small angle the form sin^2 keeps all digits where 1 - cos would keep none: directions 1e-8 rad apart.
    """
    axis = np.array([1.0, -2.0, 0.5]) / np.sqrt(5.25)
    rays = RayBundle.divergent((1.0, 2.0, 3.0), axis, half_angle, 400, sampling="gauss")
    assert np.array_equal(rays.position, np.tile([1.0, 2.0, 3.0], (len(rays), 1)))
    lag = (
        2.0
        * np.sin(0.5 * np.arctan2(np.linalg.norm(np.cross(rays.direction, axis), axis=1), rays.direction @ axis)) ** 2
    )
    expected = np.sin(0.5 * half_angle) ** 2
    assert rays.weight @ lag == pytest.approx(expected, rel=1e-7)
    assert rays.weight @ lag**2 == pytest.approx(4.0 / 3.0 * expected**2, rel=1e-7)
    assert lag.max() <= 2.0 * expected * (1.0 + 1e-7)
    across = np.stack(transverse_axes(axis)) @ rays.direction.T
    assert np.abs(across @ rays.weight).max() < 1e-15


@pytest.mark.parametrize("half_angle", [0.0, -0.1, 3.2, np.nan])
def test_half_angles_that_are_none(half_angle):
    with pytest.raises(ValueError, match=r"half_angle must lie in \(0, pi\] rad"):
        RayBundle.divergent((0, 0, 0), (0, 0, 1), half_angle)


def test_through_a_pupil_and_back():
    """Both ways are the same lines: from the point through the pupil, and from the pupil toward the point."""
    pupil, point = Disc(0.01, (0.0, 0.0, -0.008)), np.array([0.03, -0.02, 1.5])
    there = RayBundle.through(pupil, point, 50)
    back = RayBundle.through(pupil, point, 50, toward_point=True)
    points, _ = pupil.sample(50)
    assert np.array_equal(there.position, np.tile(point, (50, 1))) and np.array_equal(back.position, points)
    assert np.abs(there.direction + back.direction).max() < 1e-15
    reach = np.linalg.norm(points - point, axis=1)
    assert np.abs(there.position + reach[:, None] * there.direction - points).max() < 1e-14
    assert np.array_equal(there.weight, back.weight)


def test_through_a_point_of_the_pupil_has_no_direction():
    pupil = Disc(1.0)
    with pytest.raises(ValueError, match="1 ray directions are zero, the first is ray 3"):
        RayBundle.through(pupil, pupil.sample(10)[0][3], 10)


@pytest.mark.parametrize(
    ("position", "direction", "weight", "message"),
    [
        (np.zeros((2, 2)), np.ones((2, 3)), None, r"positions must have shape \(ray_count, 3\), got \(2, 2\)"),
        (np.zeros((0, 3)), np.ones((0, 3)), None, r"the bundle holds no ray"),
        (np.zeros((2, 3)), np.ones((2, 2)), None, r"directions must have shape \(ray_count, 3\), got \(2, 2\)"),
        (np.zeros((3, 3)), np.ones((2, 3)), None, "3 ray positions but 2 directions"),
        ([[0, 0, 0], [0, np.nan, 0]], np.ones((2, 3)), None, "1 ray positions are not finite, the first is ray 1"),
        (np.zeros((2, 3)), [[np.inf, 0, 0], [1, 0, 0]], None, "1 ray directions are not finite, the first is ray 0"),
        (np.zeros((3, 3)), [[1, 0, 0], [0, 0, 0], [0, 0, 0]], None, "2 ray directions are zero, the first is ray 1"),
        (np.zeros((2, 3)), np.ones((2, 3)), [1.0], "weights must be finite, not negative and not all zero"),
        (np.zeros((2, 3)), np.ones((2, 3)), [1.0, -1.0], "weights must be finite"),
        (np.zeros((2, 3)), np.ones((2, 3)), [0.0, 0.0], "weights must be finite"),
        (np.zeros((2, 3)), np.ones((2, 3)), [1.0, np.nan], "weights must be finite"),
        (np.zeros((2, 3)), np.ones((2, 3)), [1e308, 1e308], r"greatest ray weight is 1e\+308: scale the weights"),
    ],
)
def test_what_is_no_bundle(position, direction, weight, message):
    with pytest.raises(ValueError, match=message):
        RayBundle(position, direction, weight)
