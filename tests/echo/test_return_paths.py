"""The ways back: chunks, symmetry, vignetting, every target point."""

import numpy as np
import pytest

from aerokernels import echo
from aerokernels.lidar import return_paths as module
from aerokernels.lidar.parts import Setup
from aerokernels.lidar.return_paths import reduce_pupils, return_paths
from aerokernels.medium import Body, IndexField
from aerokernels.scene import Scene
from tests.echo.test_paths import nodes
from tests.return_opd import return_opd

WAVE_NUMBER = 2.0 * np.pi / 905e-9


def scene(**changes):
    settings = {"trace.precision": "float64", "receiver.ray_count": 64}
    return Scene.load(
        "wind-tunnel-static", settings | {key.replace("__", "."): value for key, value in changes.items()}
    )


def blob_field(strength, body=None):
    """A round lump of gas on the axis."""
    r, z = np.arange(0.0, 0.0601, 0.001), np.arange(-0.02, 0.0801, 0.001)
    contrast = strength * np.exp(-(r[:, None] ** 2 + (z - 0.03) ** 2) / 0.012**2)
    return IndexField.from_samples(
        contrast, origin=(0.0, -0.02), spacing=(1e-3, 1e-3), geometry="axisymmetric", body=body
    )


def target_intersections(count=60, seed=3):
    generator = np.random.default_rng(seed)
    xy = generator.uniform(-1.0, 1.0, (count, 2)) * (0.06, 0.045)
    return np.column_stack([xy, np.full(count, 1.492)])


def test_chunks_change_nothing(monkeypatch):
    """Sums of 7 pupils of 64 rays, in one chunk and in chunks that break pupils apart: rounding, 1e-12.

    They are the sums of the rays' own OPDs.
    """
    setting, field, target = scene(trace__method="adaptive"), blob_field(5e-5), target_intersections(7)
    setup = Setup.of_scene(setting)
    pupil = setup.receiver.pupil.sample(64, "gauss")
    whole = reduce_pupils(setup, field, target, *pupil)
    opd, share, _ = return_opd(setting, field, target)
    assert whole.phasor == pytest.approx(np.sum(share * np.exp(1j * WAVE_NUMBER * opd), axis=1), abs=1e-12)
    assert whole.open_share == pytest.approx(np.ones(7), abs=1e-12)
    assert whole.ray_count == 448
    monkeypatch.setattr(module, "CHUNK_RAYS", 50)
    parts = reduce_pupils(setup, field, target, *pupil)
    assert parts.phasor == pytest.approx(whole.phasor, abs=1e-12)
    assert parts.evaluation_count == whole.evaluation_count


def test_a_radius_stands_for_the_target():
    """Set-up: a lump on the axis, facing target. With the symmetry and without, within 1e-3 of interpolation."""
    setting, field, intersection = scene(receiver__ray_count=256), blob_field(5e-5), target_intersections()
    short = return_paths(nodes(setting, 9), field, intersection)
    full = return_paths(nodes(setting, 9), field, intersection, symmetry=False)
    assert np.ptp(full.factor) > 0.005
    assert np.abs(short.factor - full.factor).max() < 1e-3
    assert short.sums.ray_count < full.sums.ray_count / 25 and short.pair_count == full.pair_count
    tilted = scene(target__tilt=0.2)
    assert return_paths(nodes(tilted, 5), field, intersection).sums.ray_count == 25 * 64


def test_a_rectangle_is_not_symmetric_about_the_axis():
    """Set-up: the same through a slit 12 mm by 3 mm. It sees points in x and in y differently, by more than errors."""
    setting = scene(receiver__ray_count=256, receiver__shape="rectangle", receiver__height="3 mm")
    field, intersection = blob_field(5e-5), target_intersections()
    found = return_paths(nodes(setting, 9), field, intersection)
    every = return_paths(nodes(setting, "every"), field, intersection)
    assert found.sums.ray_count == 81 * 256
    assert np.abs(found.factor - every.factor).max() < 1e-3
    in_x = np.abs(intersection[:, 0]) > np.abs(intersection[:, 1])
    assert abs(every.factor[in_x].mean() - every.factor[~in_x].mean()) > 1e-3


def test_every_target_point_may_have_its_own_pupil():
    """Set-up: the same. Every point by itself against the interpolation, and against the rays' own OPDs."""
    setting, field, intersection = scene(), blob_field(5e-5), target_intersections(20)
    intersection[4] = np.nan
    every = return_paths(nodes(setting, "every"), field, intersection)
    assert np.isnan(every.factor[4]) and every.pair_count == 19 * 64
    good = np.isfinite(every.factor)
    opd, share, _ = return_opd(setting, field, intersection[good])
    exact = np.abs(np.sum(share * np.exp(1j * WAVE_NUMBER * opd), axis=1)) ** 2
    assert every.factor[good] == pytest.approx(exact, abs=1e-9)
    between = return_paths(nodes(setting, 9), field, intersection, symmetry=False)
    assert np.abs(between.factor[good] - exact).max() < 1e-3


def washer():
    """A ring around the axis that covers the pupil's outer half: radii 3 mm to 12 mm, at z = 0 to 2 mm."""
    corner = np.array([[0.003, 0.0], [0.012, 0.0], [0.012, 0.002], [0.003, 0.002]])
    return Body(corner)


@pytest.mark.parametrize("kind", ["strehl", "bucket", "none"])
def test_return_factors_of_a_vignetted_pupil(kind):
    """Set-up: no contrast, a body with a hole of 3 mm 8 mm ahead of a pupil of 6 mm radius, target on the axis.

    Formula: the hole's shadow edge on the pupil lies at 3 mm x 1.5 / 1.492 (the light comes from 1.5 m): a share of
    (3.016 / 6)^2 = 0.2527. "none" does not care. Error: Gauss rings either side of the edge. Tolerance: 0.02 (a ring).
    """
    setting = scene(receiver__return_factor=kind, receiver__ray_count=4096)
    field = blob_field(0.0, washer())
    found = return_paths(nodes(setting, 3), field, np.array([[0.0, 0.0, 1.492], [1e-3, 0.0, 1.492]]))
    if kind == "none":
        assert found.factor.tolist() == [1.0, 1.0] and np.isnan(found.strehl).all() and found.sums.ray_count == 0
    else:
        assert found.factor == pytest.approx([0.2527] * 2, abs=0.02)
        assert found.strehl == pytest.approx([1.0, 1.0], abs=1e-9)
        assert found.open_share == pytest.approx(found.factor, abs=1e-9)


def test_phase_alone_loses_no_light_into_a_bucket():
    """The lump spoils the focus, not the flux: peaks with "bucket" and "none" are those of still air, "strehl" less."""
    peak = {}
    for kind in ("strehl", "bucket", "none"):
        found = echo(scene(receiver__return_factor=kind), field=blob_field(5e-5))
        peak[kind] = found.peak_power
        assert found.return_factor == pytest.approx(found.strehl if kind == "strehl" else np.ones(len(found.path)))
    still = echo(scene(), field=blob_field(0.0)).peak_power
    assert peak["bucket"] == pytest.approx(still, rel=1e-6) and peak["none"] == pytest.approx(still, rel=1e-6)
    assert peak["strehl"] < 0.9 * still


def test_a_pupil_that_sees_nothing_is_refused():
    corner = np.array([[0.0, 0.002], [0.02, 0.002], [0.02, 0.0], [0.0, 0.0]])
    lid = Body(corner)
    with pytest.raises(ValueError, match=r"no ray of the receiver's pupil gets out.*HIT_BODY"):
        return_paths(nodes(scene(), 3), blob_field(0.0, lid), target_intersections(3))
