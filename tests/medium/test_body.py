"""Solid bodies: inside, nearest wall, signed distance, against circles, brute force and the shipped model."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerokernels import Body, flow


def polygon(count: int = 720, radius: float = 1.0, center=(0.0, 0.0)) -> np.ndarray:
    angle = 2.0 * np.pi * np.arange(count) / count
    return np.stack([center[0] + radius * np.cos(angle), center[1] + radius * np.sin(angle)], axis=1)


def half_disc(count: int = 360, radius: float = 1.0) -> np.ndarray:
    """A sphere's profile from the nose (0, R) over r = R to (0, -R), closed along the axis."""
    angle = np.pi * np.arange(count + 1) / count
    profile = radius * np.stack([np.sin(angle), np.cos(angle)], axis=1)
    profile[[0, -1], 0] = 0.0
    return profile


def distance_by_brute_force(body: Body, points: np.ndarray) -> np.ndarray:
    best = np.full(len(points), np.inf)
    for a, b in zip(*body.surface, strict=True):
        along = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(points - a - along[:, None] * (b - a), axis=1))
    return best


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_a_circle_has_the_distance_of_a_circle(geometry):
    """Set-up: a polygon of 720 corners on a unit circle (axisymmetric: half of it, a sphere).

    Formula: d = |p| - 1. Error: the polygon lies inside the circle by at most 1 - cos(pi / 720) = 9.5e-6.
    """
    body = Body(polygon(), "planar") if geometry == "planar" else Body(half_disc(), "axisymmetric")
    points = np.random.default_rng(0).uniform(-2.0, 2.0, (2000, 2))
    if geometry == "axisymmetric":
        points[:, 0] = np.abs(points[:, 0])
    exact = np.linalg.norm(points, axis=1) - 1.0
    assert np.abs(body.signed_distance(points) - exact).max() < 1e-5
    clear = np.abs(exact) > 1e-5
    assert np.array_equal(body.contains(points)[clear], exact[clear] < 0.0)
    foot = body.nearest_wall(points)
    assert np.abs(np.linalg.norm(foot, axis=1) - 1.0).max() < 1e-5
    assert np.linalg.norm(foot - points / np.linalg.norm(points, axis=1, keepdims=True), axis=1).max() < 0.01


def test_the_axis_is_no_wall():
    """Deep inside a sphere the nearest wall is the surface, not the profile's closing line along r = 0."""
    body = Body(half_disc(), "axisymmetric")
    assert body.signed_distance(np.array([[0.01, 0.0], [0.0, 0.5]])) == pytest.approx([-0.99, -0.5], abs=1e-4)
    start, end = body.surface
    assert len(start) == 360 and not ((start[:, 0] == 0.0) & (end[:, 0] == 0.0)).any()


@given(seed=st.integers(0, 10_000), count=st.integers(3, 40), crowd=st.floats(0.0, 6.0))
@settings(max_examples=60, deadline=None)
def test_nearest_wall_is_the_nearest(seed, count, crowd):
    """Star-shaped profiles whose points crowd together at one end: short segments beside long ones.

    The foot must lie on the wall and be as near as brute force over all segments finds; rounding only.
    """
    rng = np.random.default_rng(seed)
    share = np.sort(rng.uniform(0.0, 1.0, count))
    angle = 2.0 * np.pi * share ** (1.0 + crowd)
    radius = rng.uniform(0.3, 1.0, count)
    body = Body(np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1), "planar")
    points = rng.uniform(-1.5, 1.5, (100, 2))
    foot = body.nearest_wall(points)
    assert np.abs(np.linalg.norm(foot - points, axis=1) - distance_by_brute_force(body, points)).max() < 1e-12
    assert distance_by_brute_force(body, foot).max() < 1e-12


def test_the_shipped_model():
    """Brute force over the outline; the nose tip, a point ahead of it, one within and one above the cylinder."""
    body = flow.shipped("mach3").body
    low, high = body.profile.min(axis=0), body.profile.max(axis=0)
    points = np.random.default_rng(2).uniform(low, high + 0.01, (400, 2))
    distance = body.signed_distance(points)
    assert np.abs(np.abs(distance) - distance_by_brute_force(body, points)).max() < 1e-15
    assert np.array_equal(distance < 0.0, body.contains(points))
    assert body.contains(np.array([[0.0, -1e-6], [0.0, 1e-6], [1e-3, -0.06], [0.5, -0.06]])).tolist() == [
        True, False, True, False,
    ]  # fmt: skip
    assert abs(body.signed_distance(np.array([[0.0, 3e-3]]))[0] - 3e-3) < 1e-15


@pytest.mark.parametrize(
    ("profile", "geometry", "message"),
    [
        ([[0.0, 0.0], [1.0, 0.0]], "planar", r"at least three points.*\(2, 2\)"),
        (np.zeros((4, 3)), "planar", r"shape \(k, 2\), got \(4, 3\)"),
        ([[0.0, 0.0], [1.0, np.nan], [0.0, 1.0]], "planar", r"1 of 6 samples of the body profile.*index \(1, 1\)"),
        ([[0.0, 0.0], [-1.0, 0.5], [0.0, 1.0]], "axisymmetric", "negative radius"),
        (polygon(), "volume", "'planar' or 'axisymmetric', got 'volume'"),
        ([[0.0, 0.0], [0.0, 1.0], [0.0, 2.0]], "axisymmetric", "encloses nothing"),
        ([[1.0, 1.0]] * 3, "planar", "encloses nothing"),
    ],
)
def test_what_is_refused(profile, geometry, message):
    with pytest.raises(ValueError, match=message):
        Body(profile, geometry)


def test_edges_with_solid_or_air_on_both_sides_are_no_walls_to_distances():
    """Set-up: two squares joined by a bridge of no width, and a square with a slit that closes."""
    bridge = [[0, 0], [1, 0], [1, 0.4], [3, 0.4], [3, 0], [4, 0], [4, 1], [3, 1], [3, 0.4], [1, 0.4], [1, 1], [0, 1]]
    points = np.array([[2.0, 0.41], [2.0, 0.3], [1.2, 0.4]])
    assert Body(np.array(bridge), "planar").signed_distance(points) == pytest.approx([1.0, 1.0, 0.2], abs=1e-12)
    slit = [[0, 0], [4, 0], [4, 4], [2, 4], [2, 1], [2, 4], [0, 4]]
    points = np.array([[2.1, 2.0], [2.0, 2.5], [2.0, 0.5]])
    for profile in (slit, slit[::-1]):
        body = Body(np.array(profile, dtype=float), "planar")
        assert body.signed_distance(points) == pytest.approx([-1.9, -1.5, -0.5], abs=1e-12)


def test_normals_of_curves_and_edges():
    """A round nose on a cylinder: those of the circle where it turns, the segments' own beside edges and flat parts."""
    angle = np.linspace(0.0, 0.5 * np.pi, 31)
    nose = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    nose[0, 0] = 0.0
    body = Body(np.concatenate([nose, [[1.0, -2.0], [1.0, -4.0], [0.0, -4.0]]]))
    start, end = body.surface
    for points, normals in zip((start, end), body.normals.swapaxes(0, 1), strict=True):
        round_part = np.minimum(start[:, 1], end[:, 1]) > 0.1  # but for the last chord, which the cylinder makes flat
        assert np.abs(normals - points)[round_part].max() < 1e-12

    flat = body.normals[np.maximum(start[:, 1], end[:, 1]) < 1e-9]
    assert {tuple(normal.round(12)) for normal in flat.reshape(-1, 2)} == {(1.0, 0.0), (0.0, -1.0)}
