"""Echoes of small scenes through a lump of gas: paths, ranges and their errors; ranging of single waveforms."""

import numpy as np
import pytest

from aerokernels import echo, estimate_range, plane_target_echo, range_statistics
from aerokernels.echo import RANGING_METHODS
from aerokernels.echo.chain import DetectorChain
from aerokernels.echo.detector import detect, memory_time
from aerokernels.echo.noise import NoiseSources, noise_bandwidth
from aerokernels.echo.pulse_curve import PulseCurve, peak_height
from aerokernels.echo.pulses import GaussianPulse, HeliosPulse, SampledPulse
from aerokernels.echo.range_error import cramer_rao_range
from aerokernels.echo.range_walk import range_walk
from aerokernels.echo.ranging import Reading
from aerokernels.scene import Scene

from .records import Nudge
from .scenes import SINGLE, lump

pytestmark = pytest.mark.filterwarnings("ignore")
STAGES = ("echo/",)
FEW = {
    "beam.ray_count": 64,
    "receiver.ray_count": 64,
    "detector.volts_per_watt": 5558.7,
    "detector.threshold": 1.0,
    "trace.backend": "opencl",
}
RECORDER = {"detector.noise": True, "detector.bit_count": 8, "detector.bandwidth": 150e6, "detector.trial_count": 5}
SCENES = {
    "plain": {},
    "paper": {"target.limits": "paper", "target.tilt": 0.5, "detector.ranging": "centroid"},
    "recorder": {**RECORDER, "detector.ranging": "constant-fraction"},
    "matched": {**RECORDER, "detector.ranging": "matched-filter", "target.specular_share": 0.4, "target.tilt": 0.1},
    "slow": {"detector.bandwidth": 40e6, "detector.sample_rate": 1e9, "detector.walk_correction": True},
}


@pytest.mark.parametrize("name", SCENES)
def test_scene(answers, name: str):
    """The echo, its quantities and errors."""

    def case(nudge: Nudge):
        found = echo(Scene.load("wind-tunnel-static", {**FEW, **SCENES[name]}), field=lump(nudge), phase_error=0.05)
        return found.errors, found.quantities, found.ranges, found.power, found.mean_strehl, found.statistics

    answers(case, nudge=SINGLE)


def waveform(nudge: Nudge, period: float, width: float = 4e-9) -> tuple[np.ndarray, np.ndarray]:
    """A pulse of 1 V with a tail, cut off at the end."""
    time = np.arange(0.0, 60e-9, period)
    return time, nudge(np.exp(-(((time - 20e-9) / width) ** 2)) + 0.2 * np.exp(-(((time - 27e-9) / 6e-9) ** 2)))


@pytest.mark.parametrize("period", [1e-10, 1.3e-9, 4e-9])
def test_reading(answers, period: float):
    """Every method on fine and coarse samples, with the pulse's shape and without."""

    def case(nudge: Nudge):
        time, voltage = waveform(nudge, period)
        found = []
        pulse = GaussianPulse(4e-9)
        for method in RANGING_METHODS:
            for shape in (None, pulse):
                given = {"threshold": 0.4} if method == "leading-edge" else {}
                given |= {"template": pulse} if method == "matched-filter" else {}
                reading = Reading(method, **given, shape=shape)
                found += [reading.range(time, voltage), reading.sampling_error(time, voltage)]
            found.append(estimate_range(time, voltage, method, **given))
            if period == 1.3e-9:
                found.append(
                    range_statistics(
                        time, voltage, method, noise_rms=0.02, trial_count=20, seed=3, true_range=3.0, **given
                    )
                )
        curve = PulseCurve(voltage)
        return found, peak_height(voltage), curve.peak_position, curve.centroid, cramer_rao_range(time, voltage, 0.01)

    answers(case)


def test_walk(answers):
    """Range walk by peak and by width."""

    def case(nudge: Nudge):
        walk = range_walk(*waveform(nudge, 5e-10), 0.1)
        return walk, [walk.at_peak(one) for one in (0.2, 0.7)], walk.at_width(5e-9)

    answers(case)


@pytest.mark.parametrize("response", ["bessel", "butterworth", "gaussian"])
def test_chain(answers, response: str):
    """Filters, noise, saturation and memory."""

    def case(nudge: Nudge):
        time, power = waveform(nudge, 5e-10)
        sources = NoiseSources(background_power=2e-8)
        chain = DetectorChain(2e3, sources, 2e8, response, 3, saturation=1500.0)
        clear = chain.voltage(time, 1e-6 * power), chain.linear_voltage(time, power), chain.noise_rms(1e-7, 2e9)
        noise = chain.noise(1e-6 * power, 5e-10, 1), chain.record(time, 1e-6 * power, 2), sources.thermal_density
        others = detect(time, power, volts_per_watt=2.0, bandwidth=3e8, response=response, order=2)
        return *clear, *noise, others, memory_time(2e8, response, 3), noise_bandwidth(2e8, response, 3, 5e9)

    answers(case)


def test_closed_form(answers):
    """The echo of a tilted plane by its options, and shapes of pulses."""

    def case(nudge: Nudge):
        time = np.linspace(6.5e-7, 7.2e-7, 60)
        found = []
        plain = {
            "peak_power": nudge(75.0),
            "receiver_diameter": 0.012,
            "beam_radius": 0.03,
            "distance": 102.0,
            "pulse_tau": 6e-9,
            "reflectivity": 0.3,
        }
        for more in (
            {},
            {"tilt": 0.9},
            {"tilt": 1.2, "limits": "paper"},
            {"tilt": 0.4, "specular_share": 0.5},
            {"width": 0.02, "height": 0.03, "tilt": 0.5},
            {"pulse_tau": HeliosPulse(4e-9), "tilt": 0.7},
            {"atmospheric_transmission": 0.9, "system_efficiency": 0.5, "strehl": 0.8},
        ):
            found.append(plane_target_echo(time, **{**plain, **more}))
        shapes = GaussianPulse(3e-9), HeliosPulse(3e-9), SampledPulse(np.array([0.0, 0.2, 1.0, 0.7, 0.1, 0.0]), 2e-9)
        return found, [(one(time - 6.8e-7), one.support, one.timescale, one.duration) for one in shapes]

    answers(case)
