"""Few samples across a pulse: right by the pulse's shape where it is given, warned of with the error where not."""

import functools
import warnings

import numpy as np
import pytest

from aerokernels import Scene, echo, estimate_range, range_statistics
from aerokernels.lidar import RANGING_METHODS, CoarseSamplingWarning
from aerokernels.lidar.pulses import SPEED_OF_LIGHT, GaussianPulse, HeliosPulse
from aerokernels.lidar.ranging import Reading

TAU = 6e-9
HALF_C = 0.5 * SPEED_OF_LIGHT
BARE = [method for method in RANGING_METHODS if method != "matched-filter"]
SHAPES = {"gaussian": GaussianPulse(TAU), "helios": HeliosPulse(2.943e-9)}
PHASES = np.arange(9) / 9.0


def record(shape, period: float, phase: float, peak: float = 2.0, noise: float = 0.0, seed: int = 0):
    """Samples of a pulse that arrives `phase` of a period after the 20th of 64 samples; times, volts, arrival."""
    time = np.arange(64) * period
    arrival = (20.0 + phase) * period
    return time, peak * shape(time - arrival) + noise * np.random.default_rng(seed).normal(size=64), arrival


@functools.cache
def exact(shape, method: str, peak: float = 2.0, threshold: float = 1.0) -> float:
    """The method's reading of the pulse itself, of time zero [s], from a million samples of it."""
    time = np.linspace(-30e-9, 110e-9, 1_400_001)
    volts = peak * shape(time)
    if method == "centroid":
        held = volts >= 0.1 * peak
        return float(time[held] @ volts[held] / volts[held].sum())
    return float(time[np.argmax(volts >= (threshold if method == "leading-edge" else 0.5 * peak))])


@pytest.mark.parametrize("per_tau", [0.8, 1.2, 2.0, 5.0])
@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("method", RANGING_METHODS)
def test_a_known_shape_makes_every_method_right_however_few_samples(method, name, per_tau):
    """Set-up: noise-free pulses of 10 ns at 0.8 to 5 samples a tau of 6 ns, at nine phases, the shape as the template.

    Expected: the bare reading of the pulse itself for the leading edge, the arrival for the others (the template's own
    reading is taken off). Error: the Gaussian's 1.4e-13 s of the exact reading's samples, and the quintic at 16 samples
    a pulse, 0.01 mm; HELIOS starts with a jump of its curvature, 0.5 mm (by its samples alone: 40 to 660 mm).
    """
    shape = SHAPES[name]
    truth = exact(shape, method) if method == "leading-edge" else 0.0
    errors = []
    for phase in PHASES:
        time, volts, arrival = record(shape, TAU / per_tau, phase)
        with warnings.catch_warnings():
            warnings.simplefilter("error", CoarseSamplingWarning)
            reading = estimate_range(time, volts, method, threshold=1.0, template=shape)
        errors.append(reading - HALF_C * (arrival + truth))
    assert np.abs(errors).max() < (3e-5 if name == "gaussian" else 2e-3)


@pytest.mark.parametrize("method", BARE)
def test_few_samples_without_the_shape_are_told_of(method):
    """Set-up: Gaussian pulses at 1.2 samples a tau, nothing known of them. Readings are 4 to 38 mm off."""
    truth, off = exact(SHAPES["gaussian"], method), []
    for phase in PHASES:
        time, volts, arrival = record(SHAPES["gaussian"], TAU / 1.2, phase)
        with pytest.warns(CoarseSamplingWarning, match=r"2\.?\d? samples across .*too few for method"):
            reading = estimate_range(time, volts, method, threshold=1.0)
        off.append(abs(reading - HALF_C * (arrival + truth)))
    assert 3e-3 < max(off) < 40e-3


def test_the_warning_is_the_callers():
    time, volts, _ = record(SHAPES["gaussian"], TAU / 1.2, 0.4)
    with pytest.warns(CoarseSamplingWarning) as told:
        estimate_range(time, volts, "centroid")
        range_statistics(time, volts, "centroid", noise_rms=1e-3, trial_count=2)
    assert [one.filename for one in told] == 2 * [__file__]


@pytest.mark.parametrize("method", RANGING_METHODS)
def test_enough_samples_are_not_warned_of(method):
    """Twelve samples a tau, with noise: no warning."""
    shape = SHAPES["gaussian"]
    time, volts, _ = record(shape, TAU / 12.0, 0.3, noise=0.02)
    template = shape if method == "matched-filter" else None
    with warnings.catch_warnings():
        warnings.simplefilter("error", CoarseSamplingWarning)
        estimate_range(time, volts, method, threshold=1.0, template=template)
        range_statistics(time, volts, method, noise_rms=0.02, trial_count=2, threshold=1.0, template=template)


@pytest.mark.parametrize("method", RANGING_METHODS)
def test_noise_at_few_samples_costs_no_more_than_the_bound_allows(method):
    """Set-up: 1.5 samples a tau, 10 mV on 2 V, shape known. Expected: the mean of 100 readings is the exact one.

    Tolerance: four standard errors of the mean, and 1 mm for the greatest sample's bias at the constant fraction.
    """
    shape, period = SHAPES["gaussian"], 4e-9
    truth = exact(shape, method) if method == "leading-edge" else 0.0
    readings = []
    for seed in range(100):
        time, volts, arrival = record(shape, period, seed / 100.0, noise=0.01, seed=seed)
        reading = Reading(method, 1.0, shape).range(time, volts)
        readings.append(reading - HALF_C * (arrival + truth))
    error = np.std(readings) / np.sqrt(len(readings))
    assert abs(np.mean(readings)) < 4.0 * error + 1e-3
    assert np.std(readings) < 15e-3


def test_a_scenes_rangefinder_reads_alike_whatever_its_digitiser():
    """Set-up: the Mach 3 scene with 10 GHz and with 160 MHz, one sample a tau, small.

    Expected: the same ranges by all four methods; the pulse's shape is that of the echo in vacuum, which the scene
    computes finely. Tolerance: 0.02 mm (40 to 60 um before, for the leading edge and the constant fraction).
    """
    small = {"beam.ray_count": 8, "receiver.ray_count": 16, "receiver.strehl_node_count": 3, "grid.spacing": "0.5 mm"}
    fine, coarse = (
        echo(Scene.load("wind-tunnel-mach3", {**small, "detector.sample_rate": rate})) for rate in ("10 GHz", "160 MHz")
    )
    for method in RANGING_METHODS:
        assert coarse.ranges[method] == pytest.approx(fine.ranges[method], abs=2e-5), method
