"""Pulse shapes: peak, width, integral, and what is refused."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from aerokernels.lidar import GaussianPulse, HeliosPulse, SampledPulse, estimate_range
from aerokernels.lidar.parts import Setup
from aerokernels.lidar.pulse_curve import PulseCurve
from aerokernels.lidar.pulses import SPEED_OF_LIGHT, as_pulse
from aerokernels.scene import Scene

TAU = 6e-9
SHAPES = [
    GaussianPulse(TAU),
    HeliosPulse(TAU),
    SampledPulse(np.exp(-(((np.arange(60) - 27.3) * 1e-9 / TAU) ** 2)), 1e-9),
]


def width_at_half(pulse):
    low, high = pulse.support
    rise = brentq(lambda t: float(pulse(t)) - 0.5, low, 0.0, xtol=1e-18)
    return brentq(lambda t: float(pulse(t)) - 0.5, 0.0, high, xtol=1e-18) - rise


@pytest.mark.parametrize("pulse", SHAPES, ids=lambda pulse: type(pulse).__name__)
def test_each_has_its_peak_of_1_at_0_and_ends_with_its_support(pulse):
    low, high = pulse.support
    time = np.linspace(low, high, 20_001)
    values = pulse(time)
    assert abs(float(pulse(0.0)) - 1.0) < 1e-12 and values.max() <= 1.0 + 1e-12 and values.min() >= 0.0
    assert abs(time[np.argmax(values)]) <= time[1] - time[0]
    # A pulse that is given by samples ends where they do: e^-(27.3 / 6)^2 here.
    assert float(pulse(1.001 * low)) < 2e-9 and float(pulse(1.001 * high)) < 1e-12


def test_widths_at_half_height():
    """1.6651 tau for the Gaussian; for u^2 exp(-u) the two roots of u^2 exp(-u) = 2 exp(-2), 3.3947 apart."""

    def half(u):
        return u**2 * math.exp(-u) - 2.0 * math.exp(-2.0)

    helios = brentq(half, 2.0, 20.0) - brentq(half, 0.0, 2.0)
    assert width_at_half(GaussianPulse(TAU)) == pytest.approx(2.0 * math.sqrt(math.log(2.0)) * TAU, rel=1e-9)
    assert width_at_half(HeliosPulse(TAU)) == pytest.approx(helios * TAU, rel=1e-9)
    assert helios == pytest.approx(3.3947, abs=1e-4)


def test_a_sampled_gaussian_is_the_gaussian():
    """Six samples a tau, peak between two of them. The quintic errs by (h / tau)^6 x H6 / 6! = 4e-6. Tolerance 1e-5."""
    time = np.linspace(-4.0, 4.0, 801) * TAU
    assert np.abs(SHAPES[2](time) - SHAPES[0](time)).max() < 1e-5


@pytest.mark.parametrize("pulse", SHAPES, ids=lambda pulse: type(pulse).__name__)
def test_the_matched_filter_finds_any_of_them(pulse):
    """An echo of the template's own shape reads its delay: to the root of rounding, and the splines' 1e-4 samples."""
    time = np.arange(-200, 900) * 0.25e-9
    volts = 1.4 * pulse(time - 20.1e-9)
    reading = estimate_range(time, volts, "matched-filter", template=pulse)
    assert abs(reading - 0.5 * SPEED_OF_LIGHT * 20.1e-9) < 1e-5


def pulse_of(scene):
    return Setup.of_scene(scene).laser.shape


def test_a_scene_names_its_shape():
    assert pulse_of(Scene.load("wind-tunnel-static")) == GaussianPulse(6e-9)
    assert pulse_of(
        Scene.load("wind-tunnel-static", {"beam.pulse": "helios", "beam.pulse_tau": "2 ns"})
    ) == HeliosPulse(2e-9)
    changes = {
        "beam.pulse": "sampled",
        "beam.pulse_samples": [0, 1, 4, 2, 1, 0],
        "beam.pulse_sample_period": "3 ns",
    }
    pulse = pulse_of(Scene.load("wind-tunnel-static", changes))
    assert pulse.support[1] - pulse.support[0] == pytest.approx(15e-9)


def test_what_is_no_pulse_is_refused():
    for samples, words in (
        ([0.0, 1.0, 0.0], "at least 4"),
        ([0.0, -0.1, 1.0, 0.0], "sample 1 is -0.1"),
        ([1.0, 0.5, 0.2, 0.0], "first"),
        ([0.0, math.nan, 1.0, 0.0], "not finite"),
        ([0.0, 0.0, 0.0, 0.0], "no pulse"),
    ):
        with pytest.raises(ValueError, match=words):
            SampledPulse(samples, 1e-9)
    for make in (GaussianPulse, HeliosPulse, as_pulse):
        with pytest.raises(ValueError, match="pulse_tau"):
            make(-1.0)
    with pytest.raises(TypeError, match="pulse_tau"):
        as_pulse("6 ns")


def test_the_peak_is_the_greatest_place_beside_the_greatest_sample():
    """Random records with a peak of one or several samples: the curve at 20,000 places about it, to their distance."""
    random = np.random.default_rng(12)
    for _ in range(60):
        samples = np.exp(-((np.arange(12) - random.uniform(4.0, 7.0)) ** 2) / random.uniform(0.5, 8.0))
        curve = PulseCurve(samples + 0.1 * random.random(12))
        top = int(np.argmax(curve.samples))
        place = np.linspace(max(top - 1, 0), min(top + 1, 11), 20_001)
        values = curve.spline(place)
        assert abs(curve.peak_position - place[np.argmax(values)]) < 2e-4
        assert values.max() <= curve.peak * (1.0 + 1e-12)
