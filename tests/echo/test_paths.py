"""Ways out and back through fields whose answers are known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import j1

from aerokernels import IndexField, Plane, RayBundle, trace
from aerokernels.lidar.parts import Setup
from aerokernels.lidar.paths import target_points, transmit_paths
from aerokernels.lidar.return_paths import return_paths
from aerokernels.scene import Scene
from tests.return_opd import return_opd

WAVELENGTH = 905e-9
DEPTH = 0.06  # of the linear field [m]


def scene(**changes):
    settings = {"trace.precision": "float64", "trace.method": "adaptive", "trace.tolerance": 1e-6, **changes}
    return Scene.load("wind-tunnel-static", settings)


def nodes(setting, count):
    """The parts of a scene, with a number of points along each side of the target."""
    setup = Setup.of_scene(setting)
    return replace(setup, receiver=replace(setup.receiver, strehl_node_count=count))


def linear_field(slope, ambient=1.0):
    """Contrast slope x y between the aperture's plane and DEPTH ahead of it; cubic splines reproduce it exactly."""
    y = np.linspace(-0.03, 0.03, 61)
    contrast = np.broadcast_to(slope * y[:, None], (61, 13)).copy()
    return IndexField.from_samples(
        contrast, origin=(-0.03, -0.008), spacing=(0.001, DEPTH / 12), geometry="planar", ambient_index=ambient
    )


def blob_field(strength, center_z=0.03, size=0.012):
    """A round lump of gas on the axis: m = strength exp(-(r^2 + (z - z0)^2) / size^2), down to 1e-7 at its box."""
    r, z = np.arange(0.0, 0.0601, 0.0005), np.arange(-0.02, 0.0801, 0.0005)
    contrast = strength * np.exp(-(r[:, None] ** 2 + (z - center_z) ** 2) / size**2)
    return IndexField.from_samples(contrast, origin=(0.0, -0.02), spacing=(5e-4, 5e-4), geometry="axisymmetric")


def test_strehl_ratio_of_a_prism():
    """Set-up: a linear field ahead of the pupil, target on the axis: the wavefront is tilted, and tilt counts.

    Formula: OPD = slope x y x (1 - DEPTH / (2 R)) x DEPTH at the pupil's height y (the rays draw in toward the target);
    the Strehl ratio of a tilt over a disc is (2 J1(v) / v)^2, v = k a dOPD/dy. Expected 0.34 at the slope taken.
    Error sources: curvature of the rays, slope^2 DEPTH^3 / 6 = 1e-12 m; 256 Gauss points, 1e-9; the box ends at DEPTH.
    Tolerance 1e-5.
    """
    setting = scene()
    slope = 8e-4
    intersection = np.array([[x, y, 1.492] for x in (-1e-4, 1e-4) for y in (-1e-4, 1e-4)])
    found = return_paths(nodes(setting, 3), linear_field(slope), intersection)
    v = 2.0 * math.pi / WAVELENGTH * 0.006 * slope * DEPTH * (1.0 - DEPTH / (2.0 * 1.5))
    expected = (2.0 * j1(v) / v) ** 2
    assert 0.2 < expected < 0.9
    assert found.strehl == pytest.approx(np.full(4, expected), abs=1e-5)


def test_a_prism_bends_the_way_out():
    """Set-up: the same prism; a beam of parallel rays.

    Formula: the direction turns by psi = slope x DEPTH, so the beam lands psi (R - DEPTH / 2) higher, meets the tilted
    target at beta + psi, and R_L = R + y tan(beta) + slope DEPTH y with y where it starts, to first order in psi.
    Error sources: psi^2 R = 5e-9 m in path and length, psi^3 in angle. Tolerances 2e-8 m, 1e-8 rad.
    """
    beta, slope = 0.3, 1e-3
    setting = scene(**{"target.tilt": beta, "beam.exit_radius": 0.005, "beam.radius": 0.005})
    points = target_points(Setup.of_scene(setting))
    out = transmit_paths(Setup.of_scene(setting), linear_field(slope), points)
    psi = slope * DEPTH
    assert out.arrived.all()
    start = points.start[:, 1]
    rise = psi * (1.5 - DEPTH / 2.0)
    height = (start + rise) / (1.0 - psi * math.tan(beta))  # the plane recedes as the beam climbs
    assert np.abs(out.intersection[:, 1] - height).max() < 2e-8
    assert np.abs(np.arccos(out.incidence_cosine) - beta - psi).max() < 1e-8
    expected = 1.5 + out.intersection[:, 1] * math.tan(beta) + psi * start
    assert np.abs(out.path - expected).max() < 2e-8


def test_ambient_index_counts_on_the_whole_way():
    """No contrast, ambient index n: R_L is n times the length, inside the field's box and beyond (reading 25)."""
    setting = scene(**{"beam.exit_radius": 0.005, "beam.radius": 0.005})
    out = transmit_paths(
        Setup.of_scene(setting), linear_field(0.0, ambient=1.25), target_points(Setup.of_scene(setting))
    )
    assert np.abs(out.path - 1.25 * 1.5).max() < 1e-12
    assert np.abs(out.incidence_cosine - 1.0).max() < 1e-15


@pytest.mark.parametrize("method", ["adaptive", "straight"])
@pytest.mark.parametrize("target", [(0.0, 0.0, 1.492), (0.05, -0.03, 1.492), (0.0, 0.2, 1.492)])
def test_the_way_back_is_that_of_light_from_the_target(target, method):
    """Set-up: a lump of gas worth 1.2 waves, deflections up to 60 urad, targets up to 7.6 deg off the axis.

    Formula: reciprocity. Light from the target point to a pupil point has the same optical path whichever end it is
    traced from. Here it is traced from the target, at 1e-9 wave, to where it meets the pupil's plane, and taken on
    to the pupil point along its direction. Error sources: both miss their end a little, 1/2 psi^2 L = 1e-10 m, 1e-4
    wave; "straight" keeps to the undisturbed line. Tolerance 1e-3 wave; without the term for the plane's slant the
    farthest target would be off by half a wave.
    """
    point = np.array([target])
    field = blob_field(5e-5)
    opd, weight, _ = return_opd(scene(**{"trace.method": method}), field, point)
    from aerokernels import Disc

    pupil, _ = Disc(0.006, center=(0.0, 0.0, -0.008)).sample(256, "gauss")
    rays = RayBundle(np.repeat(point, len(pupil), axis=0), pupil - point)
    result = trace(
        field,
        rays,
        method="adaptive",
        tolerance=1e-9,
        precision="float64",
        until=Plane((0.0, 0.0, -0.008), (0.0, 0.0, -1.0)),
    )
    # The pupil's plane cuts the field's thin rim, where the contrast is 4e-10: the index there is 1.
    expected = result.opd + np.sum(result.direction * (pupil - result.position), axis=1)
    assert np.ptp(expected) > 0.2 * WAVELENGTH
    assert weight[0].sum() == pytest.approx(1.0, abs=1e-12)
    assert np.abs(opd[0] - expected).max() < 1e-3 * WAVELENGTH


def test_strehl_ratio_is_interpolated_as_well_as_it_says():
    """Set-up: a lump with structure across the target. Nine points a side against the ratio computed at the points."""
    setting = scene(**{"receiver.ray_count": 64})
    field = blob_field(5e-5)
    generator = np.random.default_rng(2)
    intersection = np.column_stack(
        [generator.uniform(-0.06, 0.06, 40), generator.uniform(-0.045, 0.045, 40), np.full(40, 1.492)]
    )
    intersection[:2, :2] = [[-0.06, -0.045], [0.06, 0.045]]
    found = return_paths(nodes(setting, 9), field, intersection)
    opd, weight, _ = return_opd(setting, field, intersection)
    field_sum = np.sum(weight * np.exp(2j * np.pi * opd / WAVELENGTH), axis=1)
    exact = np.abs(field_sum) ** 2
    assert np.ptp(exact) > 0.01
    assert np.abs(found.strehl - exact).max() < 1e-3


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="into the flow's box"):
        return_opd(scene(), linear_field(0.0), np.array([[0.0, 0.0, 0.05]]))
