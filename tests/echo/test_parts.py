"""The parts of a rangefinder made in Python: the same echo as a scene's, what they refuse, and the scene of a run."""

import json

import numpy as np
import pytest

from aerokernels import Annulus, Detector, Disc, Laser, Receiver, Scene, Target, echo, simulate_echo
from aerokernels.lidar import DetectorChain, HeliosPulse, Reflector
from tests.echo.lump_of_gas import lump

FEW = {"beam.ray_count": 64, "receiver.ray_count": 64}


@pytest.mark.parametrize("strength", [0.0, 2e-5])
def test_parts_have_the_echo_of_their_scene(strength):
    """Every number of the record, for a tilted Phong target, a HELIOS pulse and an annulus; the scene's trace too."""
    tables = {
        **FEW, "beam.pulse": "helios", "beam.pulse_tau": "3 ns", "target.tilt": 0.3, "target.reflector": "phong",
        "receiver.shape": "annulus", "receiver.inner_diameter": "4 mm", "detector.bandwidth": "200 MHz",
    }  # fmt: skip
    scene = Scene.load("wind-tunnel-static", tables)
    seen = simulate_echo(
        Laser(pulse=HeliosPulse(3e-9), ray_count=64),
        Target(tilt=0.3, reflector=Reflector(0.3, 0.5, 20.0)),
        Receiver(Annulus(6e-3, 2e-3, (0.0, 0.0, -8e-3)), ray_count=64),
        Detector(DetectorChain(5558.7, bandwidth=200e6)),
        field=lump(strength),
    )
    expected = echo(scene, field=lump(strength))
    np.testing.assert_array_equal(seen.time, expected.time)
    np.testing.assert_allclose(seen.voltage, expected.voltage, rtol=1e-12, atol=1e-15)
    assert seen.ranges == pytest.approx(expected.ranges, abs=1e-12, nan_ok=True)


def test_without_a_field_it_is_the_echo_in_vacuum():
    """The range is the distance, its error is that of quadrature, and there is no air. To show it traces no ray."""
    seen = simulate_echo(Laser(ray_count=64), Target(distance=2.0), Receiver(ray_count=64), Detector())
    assert "+-" not in repr(seen) and "error" not in seen.__dict__
    assert seen.range == pytest.approx(2.0, abs=1e-13)
    assert seen.peak_power == pytest.approx(seen.vacuum_peak_power, rel=1e-12)
    assert seen.still_air.value == seen.still_air.error == 0.0
    assert seen.quantities["range"].error < 1e-6 and "+-" in repr(seen)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Laser(peak_power=-1.0), "peak_power must be positive"),
        (lambda: Laser(ray_count=0), "ray_count"),
        (lambda: Laser(pulse="6 ns"), "pulse"),
        (lambda: Target(distance=0.0), "distance must be positive"),
        (lambda: Target(tilt=90.0), "not degrees"),
        (lambda: Target(tilt_axis=(0.0, 0.0, 0.0)), "not all zero"),
        (lambda: Target(reflector=0.3), "reflector"),
        (lambda: Target(limits="all"), "choose one of beam, paper"),
        (lambda: Receiver(Disc(6e-3, (1e-3, 0.0, 0.0))), "on the axis"),
        (lambda: Receiver(Disc(6e-3, normal=(0.0, 0.0, -1.0))), r"face \+z"),
        (lambda: Receiver(strehl_node_count=4), "odd"),
        (lambda: Receiver(return_factor="all"), "choose one of strehl, bucket, none"),
        (lambda: Detector(5558.7), "chain"),
        (lambda: Detector(ranging="edge"), "choose one of leading-edge"),
        (lambda: Detector(trial_count=1), "at least 2"),
    ],
)
def test_what_no_part_can_be_is_refused(make, words):
    with pytest.raises((ValueError, TypeError), match=words):
        make()


def test_a_run_gives_its_scene_back(tmp_path):
    scene = Scene.load("wind-tunnel-mach3", {"target.tilt": "10 deg"})
    (tmp_path / "summary.json").write_text(json.dumps({"strehl": 0.9, "scene_values": scene.as_dict()}))
    assert Scene.from_summary(tmp_path) == Scene.from_summary(tmp_path / "summary.json") == scene
    (tmp_path / "other.json").write_text("{}")
    for name, words in (("other.json", "holds no values of a scene"), ("none.json", "cannot be read")):
        with pytest.raises(ValueError, match=words):
            Scene.from_summary(tmp_path / name)
        with pytest.raises(ValueError, match=words):
            Scene.load(tmp_path / name)
    assert Scene.load(tmp_path / "summary.json") == scene
    other = Scene.load(tmp_path / "summary.json", {"target.tilt": "20 deg", "flow.source": "mach2"})
    assert other.target.tilt == pytest.approx(np.radians(20.0)) and other.flow.source == "mach2"
    assert other.receiver == scene.receiver and other.title.endswith("with target.tilt = 20 deg, flow.source = mach2")
    with pytest.raises(ValueError, match=r"summary.json \(changed\): unknown key target.tild"):
        Scene.load(tmp_path / "summary.json", {"target.tild": 1.0})


def test_the_command_line_repeats_a_run_from_its_summary(tmp_path, command_line):
    """The same Strehl ratio again, and that of a changed wavelength where that is changed."""

    def strehl(scene, *more) -> float:
        done = command_line("strehl", scene, "--rays", 2000, "--json", "--set", "grid.spacing=0.2 mm", *more)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)["value"]["value"]

    scene = Scene.load("wind-tunnel-mach3", {"flow.wavelength": "1064 nm"})
    (tmp_path / "summary.json").write_text(json.dumps({"scene_values": scene.as_dict()}))
    first = strehl("wind-tunnel-mach3", "--set", "flow.wavelength=1064 nm")
    assert strehl(tmp_path / "summary.json") == first
    assert strehl(tmp_path / "summary.json", "--set", "flow.wavelength=905 nm") == strehl("wind-tunnel-mach3")
