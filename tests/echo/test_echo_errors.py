"""What an echo's numbers may be off by, and what is known of an echo before any ray is traced."""

import math

import numpy as np
import pytest

from aerokernels import echo
from aerokernels.lidar import RANGING_METHODS
from aerokernels.lidar.rangefinder import predict_echo
from aerokernels.medium import Body, IndexField
from aerokernels.scene import Scene
from tests.echo.lump_of_gas import lump
from tests.echo.test_return_paths import blob_field, washer

FEW = {"beam.ray_count": 64, "receiver.ray_count": 64, "detector.volts_per_watt": 5558.7, "detector.threshold": 1.0}


def scene(**changes):
    return Scene.load("wind-tunnel-static", {**FEW, **changes})


def test_the_error_of_the_peak_walks_the_leading_edge():
    """Set-up: an echo of peak V and a threshold T. By each cause V has an error dV.

    The leading edge then has the error

        c tau / 2 dV / (2 V sqrt(ln V / T))

    to first order in dV, here 1e-3 of V: within 1 %. The other methods do not depend on the amplitude.
    """
    found = echo(scene(), field=lump(2e-5))
    peak, distance = found.peak_voltage, 0.5 * 299_792_458.0 * 6e-9
    walk = distance / (2.0 * peak * math.sqrt(math.log(peak)))
    for cause, error in found.error["peak_voltage"].items():
        assert found.error["leading-edge"][cause] == pytest.approx(walk * error, rel=0.01, abs=1e-7), cause
        assert found.error["peak_power"][cause] == pytest.approx(found.peak_power * error / peak, rel=0.01, abs=1e-12)
        relative = found.error["strehl"][cause] / found.mean_strehl
        assert found.error["peak_power"][cause] / found.peak_power == pytest.approx(relative, rel=0.01, abs=1e-7)
    for method in ("constant-fraction", "centroid", "matched-filter"):
        assert 0.0 < found.error[method]["total"] < 1e-6
    lines = repr(found)
    assert lines.count(" +- ") >= 4 and "range by leading-edge" in lines and "no range" not in lines


def test_coarse_codes_move_the_range():
    """Of six bits, 79 mV a code, ranges are millimetres off, and the errors say so: they said micrometres."""
    fine = echo(scene(), field=lump(2e-6))
    coarse = echo(scene(**{"detector.bit_count": 6}), field=lump(2e-6))
    for method in RANGING_METHODS:
        off, told = abs(coarse.ranges[method] - fine.ranges[method]), coarse.error[method]["total"]
        assert off <= told <= 2.2 * off + 1e-5
        assert fine.error[method]["total"] < 1e-4 < told


@pytest.mark.parametrize("limit", [{"detector.saturation": 0.8}, {"detector.adc_high": 0.8, "detector.bit_count": 12}])
def test_a_peak_that_is_cut_off_makes_every_method_depend_on_the_amplitude(limit):
    """Set-up: a peak of 2 V cut off at 0.8 V, by the amplifier or the digitiser, and a peak's error by few rays.

    Expected: the error of each method covers its change when the received power changes by that error, and is at most
    twice that. A constant fraction moves by centimetres; its reported error was half a millimetre.
    """
    few = {"receiver.ray_count": 6, "detector.threshold": 0.4}
    found = echo(scene(**limit, **few), field=lump(4e-5))
    share = found.error["peak_power"]["total"] / found.peak_power
    probe = found.budget.keywords["probe"]
    chain = probe.setup.detector.chain
    for method in RANGING_METHODS:
        read = [
            probe.rangefinder.range(probe.time, chain.clipped(chain.voltage(probe.fine, factor * probe.power)), method)
            for factor in (1.0, 1.0 + share, 1.0 - share)
        ]
        change = max(abs(read[1] - read[0]), abs(read[2] - read[0]))
        assert 0.9999 * change <= found.error[method]["total"] <= 2.0 * change + 1e-4, method
    assert found.error["constant-fraction"]["total"] > 0.02


def test_an_edge_near_the_threshold_may_be_lost():
    """The peak is above the threshold by less than its error: the range is read, its error is without bound."""
    few = {"receiver.ray_count": 6}
    peak = echo(scene(**few), field=lump(4e-5)).peak_voltage
    found = echo(scene(**few, **{"detector.threshold": 0.97 * peak}), field=lump(4e-5))
    assert math.isfinite(found.range) and math.isinf(found.quantities["range"].error)
    assert "error without bound" in repr(found)


@pytest.mark.parametrize("rate", ["0.2 GHz", "0.12 GHz"])
def test_few_samples_a_pulse_are_in_the_errors(rate):
    """Set-up: samples 5 and 8.3 ns apart on a pulse of 10 ns, against 0.1 ns. Expected: the difference is reported.

    Tolerance: 0.1 um, the rounding of interpolated curves, beside errors of millimetres.
    """
    slow, fast = (echo(scene(**{"detector.sample_rate": at}), field=lump(0.0)) for at in (rate, "10 GHz"))
    for method in RANGING_METHODS:
        told = slow.error[method]["total"] + fast.error[method]["total"] + 1e-7
        assert abs(slow.ranges[method] - fast.ranges[method]) <= told, method
    assert abs(slow.peak_voltage - fast.peak_voltage) <= slow.quantities["peak_voltage"].error
    assert fast.quantities["peak_voltage"].error < 1e-4 < slow.quantities["peak_voltage"].error


def test_noise_is_the_random_part():
    """Set-up: white noise, no trials asked for. Expected: twice the spread of 32 records, that of 100 within half."""
    noisy = {"detector.noise": True, "detector.bandwidth": "200 MHz", "detector.sample_rate": "2 GHz"}
    found = echo(scene(**noisy), field=lump(0.0))
    many = echo(scene(**noisy, **{"detector.trial_count": 100}), field=lump(0.0))
    for method in RANGING_METHODS:
        spread = many.statistics[method].random_error
        assert found.error[method]["sampling"] == pytest.approx(2.0 * spread, rel=0.5), method
    assert found.quantities["peak_voltage"].error >= found.noise_rms > 0.0


@pytest.mark.parametrize(
    "changes", [{}, {"target.distance": "30 m"}, {"target.tilt": "80 deg"}, {"detector.threshold": 1.9}]
)
def test_the_echo_in_vacuum_is_predicted(changes):
    """Expected: the peaks and the reasons that the echo itself then has, without a field."""
    predicted, found = predict_echo(scene(**changes)), echo(scene(**changes), field=lump(0.0))
    assert predicted.peak_voltage == found.vacuum_peak_voltage and predicted.peak_power == found.vacuum_peak_power
    assert dict(predicted.reasons) == dict(found.reasons)
    if not predicted.reasons:
        threshold = changes.get("detector.threshold", 1.0)
        assert predicted.least_factor == pytest.approx(threshold / found.peak_voltage, rel=1e-6)


@pytest.mark.parametrize("kind", ["bucket", "strehl"])
@pytest.mark.parametrize("ray_count", [64, 256])
def test_a_pupil_that_is_partly_blocked_has_the_error_of_its_rays(kind, ray_count):
    """Set-up: a ring that leaves a quarter of the pupil open, whose edge few rays resolve. Truth: 16384 rays.

    Expected: the peak's error covers the difference, 31 % and 16 %, within a factor of three. It was at most 0.4 %.
    """
    setting = {"receiver.return_factor": kind, "beam.exit_radius": "2 mm", "detector.threshold": 0.05}
    field = blob_field(1e-6, washer())
    few, many = (echo(scene(**setting, **{"receiver.ray_count": count}), field=field) for count in (ray_count, 16384))
    difference = abs(few.peak_power - many.peak_power)
    assert difference > 0.1 * many.peak_power
    assert difference <= few.error["peak_power"]["total"] <= 3.0 * difference


@pytest.mark.parametrize("ray_count", [6, 23, 36, 61])
def test_few_rays_on_the_same_rings_tell_what_is_between_them(ray_count):
    """Set-up: a lump of 2 mm on the axis, 30 m before the target: OPD sqrt(pi) w m exp(-(r / w)^2) over 6 mm.

    Formula: the Strehl ratio is |2 / R^2 int exp(i k OPD) r dr|^2. Error: rays that are not parallel, 1e-4 of r.
    Half of 23 rays lie on the same two rings, whose mean is the same: the told error was a millionth of what it is.
    """
    width, strength, radius = 2e-3, 4e-5, 6e-3
    r, z = np.arange(0.0, 0.0121, 2.5e-4), np.arange(0.0, 0.0121, 2.5e-4)
    contrast = strength * np.exp(-(r[:, None] ** 2 + (z - 6e-3) ** 2) / width**2)
    field = IndexField.from_samples(contrast, origin=(0.0, 0.0), spacing=(2.5e-4, 2.5e-4), geometry="axisymmetric")
    found = echo(scene(**{"receiver.ray_count": ray_count, "target.distance": "30 m"}), field=field)
    node, weight = np.polynomial.legendre.leggauss(200)
    squared = 0.5 * (node + 1.0) * radius**2
    opd = math.sqrt(math.pi) * width * strength * np.exp(-squared / width**2)
    exact = abs(0.5 * weight @ np.exp(2j * math.pi / 905e-9 * opd)) ** 2
    off = abs(found.mean_strehl - exact)
    assert off > 1e-3 and off <= found.error["strehl"]["total"] <= 3.0 * off
    assert abs(found.peak_power - found.peak_power / found.mean_strehl * exact) <= found.error["peak_power"]["total"]


@pytest.mark.parametrize("kind", ["bucket", "strehl"])
def test_a_body_that_falls_between_the_rays_is_in_the_error(kind):
    """Set-up: seven rays on one ring, 4.2 mm from the axis, in front of a hole of 5 mm: none of them is blocked.

    Formula: the open share is (5 mm x 1.5 / 1.492 / 6 mm)^2 = 0.702, the peak 1 / 0.702 of it. It was told exact.
    """
    corner = np.array([[0.005, 0.0], [0.012, 0.0], [0.012, 0.002], [0.005, 0.002]])
    settings = {"receiver.return_factor": kind, "receiver.ray_count": 7, "beam.exit_radius": "1 mm"}
    found = echo(scene(**settings), field=blob_field(1e-7, Body(corner)))
    assert found.beam_mean(found.return_factor) == pytest.approx(1.0, abs=1e-3)
    off = found.peak_power * (1.0 - 0.702)
    assert off <= found.error["peak_power"]["total"] <= 3.0 * off


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"target.distance": "30 mm"}, "into the flow's box"),
        ({"detector.bandwidth": "1 kHz"}, "do not go together"),
        ({"target.distance": "50 mm", "target.tilt": "80 deg"}, "reaches back"),
    ],
)
def test_a_scene_without_an_echo_to_compute_is_refused_before_any_ray(changes, words):
    with pytest.raises(ValueError, match=words):
        predict_echo(scene(**changes), lump(0.0))
