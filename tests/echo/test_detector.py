"""The detector's low-pass against what each filter is defined to do."""

import math

import numpy as np
import pytest
from scipy import signal

from aerokernels.lidar import GaussianPulse, detect

TIME = np.arange(0, 200e-9, 0.1e-9)
PULSE = 1e-4 * GaussianPulse(6e-9)(TIME - 80e-9)


def test_without_bandwidth_volts_follow_watts():
    assert np.array_equal(detect(TIME, PULSE, volts_per_watt=5e3), 5e3 * PULSE)


def test_gaussian_response_widens_a_gaussian():
    """Set-up: pulse of tau, low-pass exp(-(ln 2 / 2)(f / B)^2).

    Formula: the pulse's spectrum is exp(-(pi f tau)^2), so tau_out^2 = tau^2 + ln 2 / (2 pi^2 B^2) and the peak falls
    by tau / tau_out; no delay. Error sources: rounding, FFT. Tolerance 1e-10 of the peak.
    """
    bandwidth = 30e6
    wide = math.sqrt(36e-18 + math.log(2.0) / (2.0 * math.pi**2 * bandwidth**2))
    expected = 1e-4 * (6e-9 / wide) * GaussianPulse(wide)(TIME - 80e-9)
    volts = detect(TIME, PULSE, volts_per_watt=1.0, bandwidth=bandwidth, response="gaussian")
    assert np.abs(volts - expected).max() < 1e-10 * expected.max()


@pytest.mark.parametrize("response", ["first-order", "bessel"])
def test_against_the_differential_equation(response):
    """Scipy's lsim solves the analogue filter in the time domain, with the input linear between samples.

    Error source: that, (period / tau)^2 / 12 times the curvature of 2: 5e-5. Tolerance 1e-4 of the peak.
    """
    angular = 2.0 * math.pi * 60e6
    system = (
        ([angular], [1.0, angular]) if response == "first-order" else signal.bessel(4, angular, analog=True, norm="mag")
    )
    _, expected, _ = signal.lsim(system, PULSE, TIME)
    volts = detect(TIME, PULSE, volts_per_watt=1.0, bandwidth=60e6, response=response)
    assert np.abs(volts - expected).max() < 1e-4 * expected.max()


def test_nothing_wraps_around():
    """A slow detector's tail runs past the record's end; it must not show at the beginning through the FFT."""
    late = GaussianPulse(6e-9)(TIME - 155e-9)
    for response in ("first-order", "bessel"):
        volts = detect(TIME, late, volts_per_watt=1.0, bandwidth=5e6, response=response)
        assert volts[-1] > 0.05 and np.abs(volts[:800]).max() < 1e-12


def test_bad_values_are_refused():
    with pytest.raises(ValueError, match="bandwidth"):
        detect(TIME, PULSE, volts_per_watt=1.0, bandwidth=0.0)
    with pytest.raises(ValueError, match="volts_per_watt"):
        detect(TIME, PULSE, volts_per_watt=-1.0)
    with pytest.raises(ValueError, match="first-order, gaussian, bessel"):
        detect(TIME, PULSE, volts_per_watt=1.0, bandwidth=1e6, response="brick-wall")
