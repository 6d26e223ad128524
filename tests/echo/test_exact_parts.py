"""Parts of an echo by exact answers: polygons and their moments, shares of a beam, samples across a pulse."""

import math

import numpy as np
import pytest

from aerokernels import echo
from aerokernels.echo import return_paths
from aerokernels.echo.paths import target_plane
from aerokernels.echo.radiometry import _beam_panels
from aerokernels.echo.shaped_curve import ENOUGH_SAMPLES, _upsampling_factor
from aerokernels.echo.target_points import clip_polygon, polygon_points
from aerokernels.medium import IndexField
from aerokernels.scene import Scene


def moments(corners: np.ndarray) -> tuple[float, np.ndarray, float]:
    """Area, first moments, and integral of x y of a polygon, by triangles from the origin."""
    a, b = corners, np.roll(corners, -1, axis=0)
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    mixed = 2.0 * a[:, 0] * a[:, 1] + a[:, 0] * b[:, 1] + b[:, 0] * a[:, 1] + 2.0 * b[:, 0] * b[:, 1]
    return 0.5 * cross.sum(), (cross[:, None] * (a + b)).sum(axis=0) / 6.0, float(cross @ mixed) / 24.0


@pytest.mark.parametrize("sides", [3, 4, 5, 7])
@pytest.mark.parametrize("shape", [(6, 6), (4, 9), (9, 3)])
def test_points_in_a_polygon_have_its_moments(sides: int, shape: tuple[int, int]):
    """Convex, off the origin, corners at no level twice: area, moments and x y exactly, all points inside."""
    angle = 0.3 + 2.0 * np.pi * np.arange(sides) / sides
    corners = np.stack([0.02 * np.cos(angle) + 0.05, 0.01 * np.sin(angle) - 0.03], axis=1)
    points, areas = polygon_points(corners, *shape)
    area, first, mixed = moments(corners)
    assert areas.sum() == pytest.approx(area, rel=1e-12)
    assert areas @ points == pytest.approx(first, rel=1e-12)
    assert areas @ (points[:, 0] * points[:, 1]) == pytest.approx(mixed, rel=1e-12)
    along = np.roll(corners, -1, axis=0) - corners
    way = points[:, None] - corners
    assert (along[:, 0] * way[..., 1] - along[:, 1] * way[..., 0] > 0.0).all()
    assert len(np.unique(points[:, 1])) >= shape[1]


def test_a_rectangle_has_as_many_points_as_asked():
    points, areas = polygon_points(np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]]), 5, 7)
    assert len(points) == 35 and len(np.unique(points[:, 1].round(12))) == 7 and areas.sum() == pytest.approx(2.0)
    square = polygon_points(np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]]), 5)[0]
    assert len(square) == 25


def test_what_two_windows_share_does_not_depend_on_which_is_clipped():
    """A triangle and a rectangle: the area that both hold, either way round; apart they share nothing."""
    triangle = np.array([[-1.0, -0.5], [1.5, -0.2], [0.2, 1.4]])
    window = np.array([[-0.6, -1.0], [0.8, -1.0], [0.8, 0.7], [-0.6, 0.7]])
    found = [moments(clip_polygon(*pair))[0] for pair in ((triangle, window), (window, triangle))]
    assert found[0] == pytest.approx(found[1], rel=1e-12) and 0.0 < found[0] < moments(window)[0]
    assert moments(clip_polygon(triangle, 10.0 * window))[0] == pytest.approx(moments(triangle)[0], rel=1e-12)
    assert len(clip_polygon(triangle, window + 5.0)) == 0


@pytest.mark.parametrize("limit", [0.3, 1.0, 2.5])
@pytest.mark.parametrize("panel", [0.2, 1.0, 3.0])
def test_shares_of_a_gaussian_beam(limit: float, panel: float):
    """Density sqrt(2 / pi) / w exp(-2 x^2 / w^2): erf(sqrt 2 limit / w) of it, and its second moment."""
    radius = 0.8
    place, weight = _beam_panels(limit, panel, radius)
    t = math.sqrt(2.0) * limit / radius
    share = math.erf(t)
    assert weight.sum() == pytest.approx(share, rel=1e-9)
    assert np.abs(place).max() < limit and (np.diff(place) > 0.0).all()
    second = radius**2 / 4.0 * (share - 2.0 / math.sqrt(math.pi) * t * math.exp(-(t**2)))
    assert weight @ place**2 == pytest.approx(second, rel=1e-9)
    assert abs(weight @ place) < 1e-12


@pytest.mark.parametrize("width", [1, 2, 3, 5])
def test_how_many_samples_a_pulse_lacks(width: int):
    """Samples at half height and more in a row about the greatest; others, before or behind it, do not count."""
    volts = np.zeros(60)
    volts[30 : 30 + width] = 1.0
    volts[30] = 1.1
    volts[10:20] = 0.8
    volts[45:50] = 0.9
    assert _upsampling_factor(volts) == math.ceil(ENOUGH_SAMPLES / width)
    assert _upsampling_factor(volts[::-1]) == math.ceil(ENOUGH_SAMPLES / width)
    for part in (volts[30:], volts[: 30 + width]):  # up to an end of the record
        assert _upsampling_factor(part) == math.ceil(ENOUGH_SAMPLES / width)


def lump() -> IndexField:
    """Weak air about the axis, in few cells."""
    r, z = np.meshgrid(np.arange(0.0, 0.0601, 0.004), np.arange(-0.02, 0.0801, 0.004), indexing="ij")
    return IndexField.from_samples(
        1e-6 * np.exp(-(r**2 + z**2) / 0.012**2), origin=(0.0, -0.02), spacing=(4e-3, 4e-3), geometry="axisymmetric"
    )


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_points_on_the_way_back_lie_in_the_target(monkeypatch: pytest.MonkeyPatch, tilt: float):
    """Tilted, and hit off its middle: the points from which light is traced back span what was hit, in its plane."""
    scene = Scene.load("wind-tunnel-static", {"receiver.ray_count": 16, "target.tilt": tilt})
    field = lump()
    plane = target_plane(scene)
    xy = np.random.default_rng(3).uniform(-1.0, 1.0, (20, 2)) * (0.03, 0.01) + (0.02, 0.03)
    rise = ((xy - plane.point[:2]) @ plane.normal[:2]) / plane.normal[2]
    hit = np.column_stack([xy, plane.point[2] - rise])
    asked = []
    original = return_paths.reduce_pupils
    monkeypatch.setattr(
        return_paths, "reduce_pupils", lambda *given: asked.append(given[2]) or original(*given)
    )  # what is traced stays what it is
    found = return_paths.return_paths(scene, field, hit, plane, 5, symmetry=False)
    points = asked[0]
    np.testing.assert_allclose((points - plane.point) @ plane.normal, 0.0, atol=1e-12)
    np.testing.assert_allclose(points[:, :2].min(axis=0), xy.min(axis=0), atol=1e-12)
    np.testing.assert_allclose(points[:, :2].max(axis=0), xy.max(axis=0), atol=1e-12)
    assert len(points) == 25 and found.sums.ray_count == 25 * 16


def test_noise_is_the_same_unless_asked_for_other():
    """The seed is 0 by default: numbers of a paper can be made again."""
    time = np.arange(200) * 1e-9
    volts = np.exp(-(((time - 97e-9) / 6e-9) ** 2))
    options = {"noise_rms": 0.02, "trial_count": 20}
    found = [
        echo.range_statistics(time, volts, "centroid", **options, **seed) for seed in ({}, {"seed": 0}, {"seed": 1})
    ]
    assert found[0].random_error == found[1].random_error != found[2].random_error


def test_all_rays_of_an_echo_are_counted():
    """Those to the target and those back from it; without a return factor the first alone."""
    counts = {}
    for factor in ("strehl", "none"):
        changes = {"receiver.ray_count": 16, "beam.ray_count": 64, "receiver.return_factor": factor}
        scene = Scene.load("wind-tunnel-static", changes)
        counts[factor] = echo(scene, field=lump()).information["ray_count"]
    assert counts["strehl"] > counts["none"] > 0
