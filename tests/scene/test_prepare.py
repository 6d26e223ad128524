"""From a scene to its index field: the part that is resampled holds every ray, and its reported error is true."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerokernels.flow import CellDensity
from aerokernels.jobs.run import scene_strehl
from aerokernels.lidar.parts import Setup
from aerokernels.lidar.paths import target_points
from aerokernels.medium import QuadMesh
from aerokernels.prepare import prepare_field, ray_region, view_radius
from aerokernels.scene import Scene


@settings(max_examples=60, deadline=None)
@given(
    along=st.floats(0.0, 1.0),
    pupil=st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 2.0 * np.pi)),
    target=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)),
    tilt=st.floats(-60.0, 60.0),
    distance=st.floats(0.3, 3.0),
)
def test_no_line_from_pupil_to_target_leaves_the_view(along, pupil, target, tilt, distance):
    """Set-up: a straight line from any point of the pupil to any point of the tilted reflector, at any z on the way.

    Expected: it is never farther off the axis than `view_radius`. Error: rounding, 1e-12 m.
    """
    scene = Scene.load("wind-tunnel-mach3", {"target.tilt": f"{tilt} deg", "target.distance": distance})
    radius, angle = pupil[0] * 0.5 * scene.receiver.diameter, pupil[1]
    start = np.array([radius * np.cos(angle), radius * np.sin(angle), scene.receiver.aperture_z])
    side = target[1] * scene.target.height
    tip = np.deg2rad(tilt)
    end = np.array([target[0] * scene.target.width, side * np.cos(tip), start[2] + distance + side * np.sin(tip)])
    point = start + along * (end - start)
    assert np.hypot(point[0], point[1]) <= view_radius(scene, float(point[2])) + 1e-12


def test_region_reaches_from_behind_the_pupil_to_the_front_of_the_flow():
    scene = Scene.load("wind-tunnel-mach3")
    prepared = prepare_field(scene)
    (first, back), (outer, front) = prepared.region
    assert first == 0.0 and back < scene.receiver.aperture_z and front == prepared.front > 0.0
    assert outer > view_radius(scene, front)
    assert prepared.region == ray_region(scene, prepared.mesh_field)
    assert prepared.field.box[1][2] >= front


def test_uniform_field_is_the_mesh_field_within_the_error_it_tells():
    """Set-up: both fields at random points of the flow ahead of the dome.

    Expected: the rms difference is what resampling measured by its own points. Error: two samples of a spiky
    difference (the shock's), so a factor of two either way.
    """
    prepared = prepare_field(Scene.load("wind-tunnel-mach3"))
    (_, back), (outer, front) = prepared.region
    random = np.random.default_rng(5)
    points = np.zeros((20_000, 3))
    points[:, 1], points[:, 2] = random.uniform(0.0, outer, 20_000), random.uniform(back, front, 20_000)
    body = prepared.density.body
    assert body is not None and prepared.resampling is not None
    points = points[~body.contains(points[:, 1:])]
    difference = prepared.field.contrast_at(points) - prepared.mesh_field.contrast_at(points)
    assert 0.5 < np.sqrt(np.mean(difference**2)) / prepared.resampling.contrast_rms < 2.0


def test_a_finer_grid_tells_a_smaller_error_and_the_strehl_ratio_moves_less_than_told():
    """Set-up: Mach 3 at grid spacings of 0.2 and 0.1 mm, 65 536 rays, float64.

    Expected: the reported resampling error falls, and the two Strehl ratios differ by less than the coarser one's
    error budget says.
    """
    changes = {"strehl.ray_count": 65_536, "trace.precision": "float64"}
    estimates, errors = [], []
    for spacing in ("0.2 mm", "0.1 mm"):
        scene = Scene.load("wind-tunnel-mach3", changes | {"grid.spacing": spacing})
        prepared = prepare_field(scene)
        assert prepared.resampling is not None
        errors.append(prepared.resampling.opd_rms)
        estimates.append(scene_strehl(scene, prepared.field))
    assert 0.0 < errors[1] < errors[0]
    assert abs(estimates[1].value - estimates[0].value) < estimates[0].error["total"]


def test_route_mesh_traces_the_flow_where_it_is():
    prepared = prepare_field(Scene.load("wind-tunnel-mach3", {"grid.route": "mesh", "grid.interpolation": "idw"}))
    assert prepared.field is prepared.mesh_field and prepared.resampling is None
    assert prepared.field.interpolation == "idw"


@pytest.mark.parametrize("route", ["uniform", "mesh"])
def test_the_interpolant_of_averages_is_named_in_a_scene(route):
    """Expected: cells cut in four that keep their averages, and a range no wider than by a hundredth."""
    over = {"grid.route": route, "grid.spacing": "0.4 mm"}
    plain = prepare_field(Scene.load("wind-tunnel-mach3", over)).mesh_field
    named = prepare_field(Scene.load("wind-tunnel-mach3", {**over, "flow.interpolation": "conserving"})).mesh_field
    assert len(named.mesh.cells) == 4 * len(plain.mesh.cells)
    assert plain.interpolation == named.interpolation == "bilinear"
    kept, before = (np.sqrt(np.mean(field.samples.lacking_by_cell[1] ** 2)) for field in (named, plain))
    assert kept < 0.5 * before
    assert np.ptp(named.samples.values) < 1.01 * np.ptp(plain.samples.values)


def test_still_air_has_no_contrast():
    prepared = prepare_field(Scene.load("wind-tunnel-static"))
    points = np.random.default_rng(1).uniform(-0.01, 0.01, (1000, 3))
    assert np.all(prepared.field.contrast_at(points) == 0.0)


@pytest.mark.parametrize("place", ["5 mm", "2 m"])
def test_a_pupil_ahead_of_the_flow_is_refused(place: str):
    with pytest.raises(ValueError, match=r"receiver\.aperture_z = .* give a place behind it"):
        prepare_field(Scene.load("wind-tunnel-mach3", {"receiver.aperture_z": place}))


def test_the_papers_limits_light_the_flow_whatever_the_reflectors_size():
    """Summed over the beam (eq 11), the way to every aim of it lies in the region, also beyond a small reflector."""
    changes = {"target.limits": "paper", "target.distance": 0.1, "target.tilt": 0.5}
    small, wide = (
        Scene.load("wind-tunnel-mach3", {**changes, "target.width": size, "target.height": size})
        for size in (0.01, 0.5)
    )
    for z in (-0.008, 0.0, 0.004):
        assert view_radius(small, z) == view_radius(wide, z)
    points = target_points(Setup.of_scene(small))
    at_front = points.start + (0.012 / 0.1) * (points.aim - points.start)
    assert np.hypot(at_front[:, 0], at_front[:, 1]).max() <= view_radius(small, 0.004)


@pytest.mark.parametrize("spacing", ["5 cm", "40 mm", "1e9 m", "1 nm"])
def test_a_grid_that_makes_no_sense_is_refused_by_its_key(spacing):
    """Before anything is computed on it: the key, the region's size and what it takes are in the message."""
    scene = Scene.load("wind-tunnel-mach3", {"grid.spacing": spacing})
    with pytest.raises(ValueError, match=r"^grid\.spacing = .* m: spacing .* region of 0\.\d+ by 0\.\d+ m.*give"):
        prepare_field(scene)


def test_values_at_walls_count_in_a_scene_unless_it_says_otherwise():
    """Set-up: averages of 1, a wall of 2. Expected: the index there is of 2; of 1 where a scene says "bilinear"."""
    axis = np.linspace(-0.02, 0.02, 21)
    mesh = QuadMesh.structured(*np.meshgrid(axis, axis, indexing="ij"))
    wall = np.stack([axis, 0.0 * axis - 0.02], axis=1), np.full(21, 2.0)
    density = 1.0 + 1e-3 * np.arange(400.0) / 400.0
    field = CellDensity(mesh, density, 1.0, wall=wall)
    at_wall = np.c_[0.0 * axis, axis, 0.0 * axis - 0.02][1:-1]
    for said, told in (({}, 2.0), ({"flow.interpolation": "bilinear"}, 1.0)):
        scene = Scene.load("wind-tunnel-mach3", {"grid.route": "mesh", **said})
        index = prepare_field(scene, field).mesh_field
        ratio = index.contrast_at(at_wall) / (index.ambient_index - 1.0) + 1.0
        assert np.abs(ratio - told).max() < 0.01
