"""Noise, digitiser and the chain of both, against their formulas and against themselves."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import constants, signal

from aerokernels import estimate_range
from aerokernels.lidar import (
    DetectorChain,
    Digitiser,
    GaussianPulse,
    NoiseSources,
)
from aerokernels.lidar.chain import noise_bandwidth
from aerokernels.lidar.detector import low_pass_gain, memory_time
from aerokernels.lidar.range_error import summarise_ranges

PERIOD = 0.5e-9
TIME = np.arange(2000) * PERIOD
PULSE = 3.6e-4 * GaussianPulse(6e-9)(TIME - 500e-9)
QUIET = {"background_power": 0.0, "dark_current": 0.0, "amplifier_noise": 0.0}


def test_each_source_adds_its_density():
    """In numbers: 1 mA of primary current at M = 10, k = 0; 4 k T / R of 1 kOhm at 300 K; 2 pA of amplifier."""
    quiet = NoiseSources(1.0, 10.0, 0.0, temperature=1e-9, **QUIET)
    shot = 2.0 * constants.elementary_charge * 100.0 * 1.9 * 1e-3
    assert float(quiet.density(1e-3)) == pytest.approx(shot, rel=1e-9)
    light = NoiseSources(1.0, 10.0, 0.0, temperature=1e-9, **{**QUIET, "background_power": 4e-4, "dark_current": 6e-4})
    assert float(light.density(0.0)) == pytest.approx(shot, rel=1e-9)
    thermal = NoiseSources(
        1.0, 10.0, 0.0, temperature=300.0, load_resistance=1e3, **{**QUIET, "amplifier_noise": 2e-12}
    )
    assert float(thermal.density(0.0)) == pytest.approx(4.0 * constants.Boltzmann * 0.3 + 4e-24, rel=1e-12)


@pytest.mark.parametrize("order", [1, 2, 5])
def test_noise_bandwidth_of_a_butterworth(order):
    """Integral of 1 / (1 + x^2n) = (pi / 2n) / sin(pi / 2n), less the tail beyond 1e4 B: x^(1-2n) / (2n - 1)."""
    exact = math.pi / (2 * order) / math.sin(math.pi / (2 * order))
    exact -= 1e4 ** (1 - 2 * order) / (2 * order - 1)
    assert noise_bandwidth(50e6, "butterworth", order, 50e10) == pytest.approx(50e6 * exact, rel=1e-6)


@pytest.mark.parametrize("order", range(1, 11))
@pytest.mark.parametrize("response", ["butterworth", "bessel"])
def test_low_passes_are_scipys(response, order):
    """Tolerance: 100 roundings. Of the memory, the slowest pole's: the roots of a polynomial of degree 10, 1e-10."""
    frequency = np.array([0.0, 10e6, 40e6, 300e6])
    norm = {"norm": "mag"} if response == "bessel" else {}
    zeros, poles, gain = (signal.butter if response == "butterworth" else signal.bessel)(
        order, 40e6, analog=True, output="zpk", **norm
    )
    expected = signal.freqs_zpk(zeros, poles, gain, worN=frequency)[1]
    assert low_pass_gain(frequency, 40e6, response, order) == pytest.approx(expected, rel=2e-13)
    slowest = -poles.real.max() * 2.0 * math.pi  # scipy takes the frequency for an angular one
    assert memory_time(40e6, response, order) == pytest.approx(-math.log(1e-16) / slowest, rel=1e-10)


@pytest.mark.parametrize(("bandwidth", "response"), [(None, "bessel"), (100e6, "bessel"), (60e6, "butterworth")])
def test_the_samples_have_the_noise_that_the_formula_says(bandwidth, response):
    """Set-up: 400 records of 2000 samples under a steady 0.1 mW.

    Formula: rms^2 = Z^2 S B_noise. Sampling error: samples within 1 / (2 B) are alike, so at least 400 x 120 are
    independent and the rms is good to 1 / sqrt(2 x 48000) = 0.3 %. Noise that the formula has beyond the records' band,
    1 GHz, is below 1e-4 of it. Tolerance 1.5 %; also the same at the record's ends as in its middle (400 x 30: 1 %).
    """
    chain = DetectorChain(5000.0, NoiseSources(), bandwidth, response)
    power = np.full(TIME.size, 1e-4)
    generator = np.random.default_rng(2)
    noise = np.array([chain.noise(power, PERIOD, generator) for _ in range(400)])
    expected = chain.noise_rms(1e-4, 1.0 / PERIOD)
    assert abs(noise.std() / expected - 1.0) < 0.015
    for part in (noise[:, :250], noise[:, -250:]):
        assert abs(part.std() / expected - 1.0) < 0.05
    assert abs(noise.mean()) < 5.0 * expected / math.sqrt(400 * 100)


def test_the_record_is_the_voltage_in_the_mean_and_repeats():
    chain = DetectorChain(5000.0, bandwidth=100e6)
    assert np.array_equal(chain.record(TIME, PULSE, 7), chain.record(TIME, PULSE, 7))
    assert not np.array_equal(chain.record(TIME, PULSE, 7), chain.record(TIME, PULSE, 8))
    generator = np.random.default_rng(1)
    mean = np.mean([chain.record(TIME, PULSE, generator) for _ in range(200)], axis=0)
    limit = 6.0 * chain.noise_rms(PULSE.max(), 1.0 / PERIOD) / math.sqrt(200)
    assert np.abs(mean - chain.voltage(TIME, PULSE)).max() < limit
    assert chain.record(TIME, PULSE, 7, stride=4).shape == (500,)


@given(st.integers(1, 24), st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=20))
def test_a_digitiser_is_off_by_half_a_step_at_most(bits, volts):
    """Inside its range; outside it gives its ends. A record of a record is the same."""
    adc = Digitiser(bits, -0.5, 4.5)
    recorded = adc.record(volts)
    inside = np.clip(volts, -0.5, 4.5)
    assert np.abs(recorded - inside).max() <= 0.5 * adc.step * (1.0 + 1e-9)
    assert adc.codes(volts).min() >= 0 and adc.codes(volts).max() <= 2**bits - 1
    assert np.array_equal(adc.record(recorded), recorded)


def thermal_chain(bandwidth=None, response="gaussian"):
    """Noise that does not depend on the light, 1 % of the pulse's peak a sample at 2 GHz."""
    sources = NoiseSources(gain=1.0, load_resistance=1e3, temperature=300.0, **{**QUIET, "amplifier_noise": 5.7e-11})
    return DetectorChain(5000.0, sources, bandwidth, response)


def test_matched_filter_of_a_whole_chain_reaches_the_bound():
    """Set-up: 200 records; the pulse's band, 1 / (2 pi tau) = 30 MHz, lies well inside the amplifier's.

    Expected: deviation over bound 1 within 15 %. Sampling error 5 %; shot noise that the filter does not weigh, 1 %.
    """
    chain, near = thermal_chain(400e6), slice(900, 1100)
    time, power = TIME[near], PULSE[near]
    reference = chain.voltage(time, power)
    generator = np.random.default_rng(5)
    found = summarise_ranges(
        lambda: chain.record(time, power, generator),
        lambda samples: estimate_range(time, samples, "matched-filter", template=reference),
        200,
        estimate_range(time, reference, "matched-filter", template=reference),
        chain.cramer_rao_range(time, power),
    )
    assert abs(found.random_error / found.cramer_rao_bound - 1.0) < 0.15
    assert found.random_interval[0] < found.cramer_rao_bound < found.random_interval[1]
    assert found.systematic_interval[0] < 0.0 < found.systematic_interval[1]


def test_bad_values_are_refused():
    for change, words in (
        ({"bandwidth": -1.0}, "bandwidth"),
        ({"response": "brick", "bandwidth": 1e6}, "choose one of"),
        ({"order": 0}, "order"),
        ({"order": 11}, "order"),
        ({"saturation": 0.0}, "saturation"),
    ):
        with pytest.raises(ValueError, match=words):
            DetectorChain(5000.0, **change)
    for values, words in (((0,), "bit_count"), ((25,), "bit_count"), ((8, 1.0, 1.0), "below"), ((8.5,), "whole")):
        with pytest.raises(ValueError, match=words):
            Digitiser(*values)
    with pytest.raises(ValueError, match="dark_current"):
        NoiseSources(dark_current=-1e-9)
    with pytest.raises(ValueError, match="is constant"):
        DetectorChain(5000.0).cramer_rao_range(TIME, np.zeros(TIME.size))


@pytest.mark.parametrize(
    ("response", "order"), [("first-order", 4), ("butterworth", 1), ("butterworth", 2), ("bessel", 5)]
)
def test_noise_beyond_half_the_sample_rate_is_folded_back(response, order):
    """Set-up: bandwidth a fifth of the sample rate. Formula: all the noise that passes the low-pass is in the samples.

    Error: 1 / sqrt(2 n), with fewer independent samples than n, 0.3 %; tolerance four times that. A single pole's skirt
    beyond half the rate holds 12 % of the variance.
    """
    chain = DetectorChain(1e3, bandwidth=100e6, response=response, order=order)
    found = chain.noise(np.zeros(1 << 18), 2e-9, seed=4)
    assert found.std() == pytest.approx(chain.noise_rms(0.0, 0.5e9), rel=0.012)
