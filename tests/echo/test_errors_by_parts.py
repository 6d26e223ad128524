"""Errors of an echo's numbers from their parts: what its probe reads, bounds of phases, codes and noise."""

import math

import numpy as np
import pytest

from aerokernels import echo
from aerokernels.echo.echo_errors import BLOCKED_POINTS, QUADRATURE, SHIFTS, _blocked_pupil_error, echo_errors
from aerokernels.echo.pulse_curve import PulseCurve, peak_height
from aerokernels.echo.pupil_errors import open_share_error, pupil_error
from aerokernels.scene import Scene
from aerokernels.wavefront.strehl_errors import strehl_error

from .test_echo_errors import lump
from .test_return_paths import blob_field, washer

FEW = {"beam.ray_count": 64, "receiver.ray_count": 64, "detector.volts_per_watt": 5558.7, "detector.threshold": 1.0}
LIGHT = 299_792_458.0


@pytest.mark.parametrize("kind", ["strehl", "bucket", "none"])
@pytest.mark.parametrize(
    "changes",
    [{}, {"detector.noise": True, "detector.bit_count": 6}, {"detector.saturation": 1.1}, {"detector.bit_count": 5}],
)
def test_errors_are_root_sums_of_squares(kind: str, changes: dict):
    """By the rules of echo_errors.py, from the parts that its probe reads."""
    scene = Scene.load("wind-tunnel-static", FEW | {"receiver.return_factor": kind} | changes)
    result = echo(scene, field=lump(2e-5), phase_error=0.05)
    probe = result.budget.keywords["probe"]
    found = echo_errors(result, probe)
    interpolation = float(result.information["strehl_error"])
    ratio = result.mean_strehl
    parts = [strehl_error(ratio, 0.05), pupil_error(scene, lump(2e-5))] if kind != "none" else []
    if kind == "strehl":
        strehl = math.hypot(*parts, interpolation)
        assert found.strehl == pytest.approx(strehl, rel=1e-9, abs=0.0)
        share = strehl / ratio
    else:
        assert (
            math.isnan(found.strehl)
            if kind == "none"
            else found.strehl == pytest.approx(math.hypot(*parts), rel=1e-9, abs=0.0)
        )
        share = interpolation / result.beam_mean(result.return_factor)
    share = math.hypot(share, QUADRATURE)
    moved = probe.read_shifted(*SHIFTS)
    power, volts = (max(abs(change[k]) / min(1.0 + change[k], 1.0) for change, _ in moved) for k in (0, 1))
    assert found.peak_power == pytest.approx(result.peak_power * math.hypot(share, power), rel=1e-9, abs=0.0)
    noise = probe.vacuum.chain.noise_rms(result.peak_power, scene.detector.sample_rate) if result.noise_rms else 0.0
    step = 0.0 if probe.vacuum.chain.digitiser is None else probe.vacuum.chain.digitiser.step
    assert probe.code_step == step
    expected = math.hypot(result.peak_voltage * math.hypot(share, volts), 2.0 * noise, 0.5 * step)
    assert found.peak_voltage == pytest.approx(expected, rel=1e-9, abs=0.0)
    scaled = probe.read_scaled(1.0, 1.0 + share, 1.0 - share)
    codes = probe.read_digitised() if result.noise_rms < 0.5 * step else {}
    random = probe.random_errors(32) if result.noise_rms else {}
    for method, value in result.ranges.items():
        if math.isnan(value):
            continue
        walk = max(abs(one[method] - scaled[0][method]) for one in scaled) if method in scaled[0] else 0.0
        walk = math.inf if any(math.isnan(one.get(method, 0.0)) for one in scaled) else walk
        place = max(abs(errors[method]) for _, errors in moved)
        path = 0.5 * scene.flow.wavelength * 0.05 / math.pi
        told = found.ranges[method]
        assert told.systematic == pytest.approx(
            math.hypot(walk, place, path, codes.get(method, 0.0)), rel=1e-9, abs=0.0
        )
        assert told.random == pytest.approx(random.get(method, 0.0))


def test_a_probe_moves_and_scales_its_waveform():
    """Peaks and ranges of the echo in vacuum, later by shares of a sample; of the waveform times a factor, cut off."""
    scene = Scene.load("wind-tunnel-static", FEW | {"detector.saturation": 1.6, "detector.bit_count": 5})
    result = echo(scene, field=lump(2e-5), phase_error=0.05)
    probe = result.budget.keywords["probe"]
    chain = probe.vacuum.chain
    still = probe.vacuum.power(probe.fine)
    assert probe.vacuum_peaks == (peak_height(still), peak_height(chain.voltage(probe.fine, still)))
    period = probe.time[1] - probe.time[0]
    for share, ((power, volts), errors) in zip((0.3, 0.8), probe.read_shifted(0.3, 0.8), strict=True):
        fine = probe.vacuum.power(probe.fine, share * period)
        assert power == pytest.approx(peak_height(fine[:: probe.stride]) / probe.vacuum_peaks[0] - 1.0, abs=1e-12)
        record = chain.voltage(probe.fine, fine)[:: probe.stride]
        assert volts == pytest.approx(peak_height(record) / probe.vacuum_peaks[1] - 1.0, abs=1e-12)
        true = scene.target.distance + 0.5 * LIGHT * share * period
        ranges = probe.rangefinder.ranges(probe.time, record, curve=PulseCurve(record))[0]
        for method, error in errors.items():
            assert error == pytest.approx(ranges[method] - true, abs=1e-12)
    linear = chain.linear_voltage(probe.fine, probe.power)[:: probe.stride]
    low = 0.9 * 1.6 / linear.max()
    few, every = probe.read_scaled(low)[0], probe.read_scaled(low, 1.2 * 1.6 / linear.max())[1]
    assert set(few) == {"leading-edge"} and len(every) == 4
    edge = probe.rangefinder.ranges(probe.time, low * linear, ("leading-edge",), PulseCurve(low * linear))[0]
    assert few["leading-edge"] == pytest.approx(edge["leading-edge"], abs=1e-12)
    cut = np.minimum(1.2 * 1.6 / linear.max() * linear, 1.6)
    again = probe.rangefinder.ranges(probe.time, cut, tuple(every), PulseCurve(cut))[0]
    for method, value in every.items():
        assert value == pytest.approx(again[method], abs=1e-9)
    rounded, clipped = chain.digitise(probe.clean), chain.clipped(probe.clean)
    for method, change in probe.read_digitised().items():
        read = [
            probe.rangefinder.ranges(probe.time, one, (method,), PulseCurve(one))[0][method]
            for one in (rounded, clipped)
        ]
        assert change == pytest.approx(abs(read[0] - read[1]), abs=1e-12) and change > 0.0


def test_a_pupil_that_a_body_blocks_has_the_error_of_its_edge():
    """At 16 of the points that light reaches, from the first to the last; none for an open pupil."""
    scene = Scene.load("wind-tunnel-static", FEW)
    open_air = echo(scene, field=lump(2e-5), phase_error=0.05)
    assert _blocked_pupil_error(open_air, open_air.budget.keywords["probe"]) == 0.0
    field = blob_field(1e-6, body=washer())
    blocked = echo(scene, field=field, phase_error=0.05)
    probe = blocked.budget.keywords["probe"]
    points = np.flatnonzero(np.isfinite(blocked.return_factor) & (blocked.beam_share > 0.0))
    some = points[np.unique(np.linspace(0, len(points) - 1, BLOCKED_POINTS).astype(int))]
    expected = open_share_error(scene, field, blocked.target_point[some], blocked.beam_share[some])
    assert _blocked_pupil_error(blocked, probe) == pytest.approx(expected) and expected > 0.0
