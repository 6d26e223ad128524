"""The quadrature over the beam: energy, edges, homologous points."""

import math

import numpy as np
import pytest

from aerokernels import plane_target_echo
from aerokernels.lidar.parts import Setup
from aerokernels.lidar.paths import target_points, vacuum_paths
from aerokernels.lidar.pulses import SPEED_OF_LIGHT, sum_of_pulses
from aerokernels.scene import Scene

WIDE = {"target.width": 3.0, "target.height": 3.0}


def scene(**changes):
    changes = {key.replace("__", "."): value for key, value in changes.items()}
    return Setup.of_scene(Scene.load("wind-tunnel-static", changes))


@pytest.mark.parametrize("ray_count", [1, 512, 4096])
@pytest.mark.parametrize("tilt", [0.0, 0.7])
def test_all_of_the_beam_is_there(ray_count, tilt):
    """A reflector larger than the beam catches all of it: shares add up to 1 within 1e-6 (cut at 3 radii: 4e-9)."""
    points = target_points(scene(**WIDE, target__tilt=tilt, beam__ray_count=ray_count))
    assert abs(points.weight.sum() - 1.0) < 1e-6
    assert (points.weight > 0.0).all() and len(points.weight) >= ray_count


def test_the_papers_limits_cut_y_at_one_radius():
    """Whatever the reflector: erf(sqrt 2) of the beam within one radius in y, all of it in x (reading 23)."""
    for height in (0.09, 0.01):
        points = target_points(scene(target__height=height, target__limits="paper"))
        assert abs(points.weight.sum() - math.erf(math.sqrt(2.0))) < 1e-7
        assert np.abs(points.aim[:, 1]).max() < 0.03 < np.abs(points.aim[:, 0]).max()


def test_the_papers_reflector_untilted():
    """120 x 90 mm in a beam of 30 mm: erf(2 sqrt 2) erf(1.5 sqrt 2) of the power. Tolerance: quadrature, 1e-9."""
    expected = math.erf(2.0 * math.sqrt(2.0)) * math.erf(1.5 * math.sqrt(2.0))
    assert abs(target_points(scene()).weight.sum() - expected) < 1e-9


def test_rays_start_at_homologous_points():
    points = target_points(scene())
    assert points.start[:, :2] == pytest.approx(points.aim[:, :2] * 2.0 / 30.0, rel=1e-13)
    assert np.unique(points.start[:, 2]) == pytest.approx([-0.008])
    assert np.unique(points.aim[:, 2]) == pytest.approx([1.492])


@pytest.mark.parametrize("axis", [(1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (0.5, -0.3, 0.8)])
def test_edges_of_a_reflector_tilted_about_any_axis(axis):
    """Set-up: reflector 100 x 60 mm turned by 0.8 rad about an axis, 0.25 m away, in a beam from 2 mm to 40 mm.

    Formula: the share of 400 000 Gaussian rays, straight from their homologous points, that land on it, found by the
    reflector's own coordinates. All quadrature rays land on it, and nearly reach its edges. Error: Monte Carlo, 0.003.
    Without the turn of the edges it would be off by 0.03 or more.
    """
    setting = scene(
        target__tilt=0.8,
        target__tilt_axis=list(axis),
        target__distance=0.25,
        target__width=0.1,
        target__height=0.06,
        beam__radius=0.04,
    )
    points, plane = target_points(setting), setting.plane
    across, along, normal = setting.target.orientation.T
    intersection = vacuum_paths(setting, points).intersection - plane.point
    for direction, edge in ((across, 0.05), (along, 0.03)):
        place = intersection @ direction
        assert 0.97 * edge < place.max() < edge * (1.0 + 1e-9) and 0.97 * edge < -place.min() < edge * (1.0 + 1e-9)

    aim = np.random.default_rng(5).normal(scale=0.02, size=(400_000, 2))
    start = np.column_stack([aim * 0.002 / 0.04, np.full(len(aim), -0.25)])
    ray = np.column_stack([aim, np.zeros(len(aim))]) - start
    met = start - ((start @ normal) / (ray @ normal))[:, None] * ray
    caught = (np.abs(met @ across) < 0.05) & (np.abs(met @ along) < 0.03)
    assert abs(points.weight.sum() - caught.mean()) < 0.003


def test_a_target_that_reaches_the_aperture_is_refused():
    with pytest.raises(ValueError, match="smaller tilt or height"):
        target_points(scene(target__tilt=1.5, target__height=4.0))


@pytest.mark.parametrize("axis", [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
def test_an_echo_spread_over_many_pulses_is_smooth(axis):
    """Set-up: a parallel beam of 0.3 m on a wide plane 5 km away, tilted until its depth is 11 pulses.

    Expected: eq 8 about x, and the same about y. Error: 1 / R^2 over the depth, 1e-4. Separate pulses, from 23 points
    across, are 0.3 off.
    """
    pulse_tau, tilt = 1e-9, 70.0
    setting = scene(
        beam__radius=0.3,
        beam__exit_radius=0.3,
        beam__pulse_tau=pulse_tau,
        target__width=50.0,
        target__height=50.0,
        target__distance=5000.0,
        target__tilt=math.radians(tilt),
        target__tilt_axis=axis,
    )
    points = target_points(setting)
    path = vacuum_paths(setting, points).path
    late = np.linspace(-15.0, 20.0, 101) * pulse_tau
    found = sum_of_pulses(late, 2.0 * (path - 5000.0) / SPEED_OF_LIGHT, points.weight, setting.laser.shape)
    exact = plane_target_echo(
        late + 1e4 / SPEED_OF_LIGHT,
        peak_power=1.0,
        receiver_diameter=2.0 * 5000.0 / math.sqrt(math.cos(math.radians(tilt))),
        beam_radius=0.3,
        distance=5000.0,
        tilt=math.radians(tilt),
        pulse_tau=pulse_tau,
        reflectivity=1.0,
    )
    assert np.abs(found - exact).max() < 1e-3 * exact.max()


def test_a_target_too_deep_for_its_pulse_is_refused():
    with pytest.raises(ValueError, match=r"longer beam\.pulse_tau"):
        target_points(scene(target__tilt=1.4, target__tilt_axis=[1.0, 1.0, 0.0], beam__pulse_tau="1 fs"))
