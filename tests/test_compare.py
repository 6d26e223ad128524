"""Recorded against simulated waveforms."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerokernels import compare_waveforms
from aerokernels.compare import pearson_correlation

TIME = np.arange(200) * 0.5e-9


def pulse(arrival=50e-9, peak=2.0, tau=6e-9):
    return peak * np.exp(-(((TIME - arrival) / tau) ** 2))


@settings(max_examples=50, deadline=None)
@given(st.integers(2, 60), st.integers(0, 2**32 - 1), st.floats(-1e6, 1e6), st.floats(1e-6, 1e6))
def test_correlation_is_numpys(count, seed, offset, scale):
    """Eq 13-14 is one element of numpy's matrix, and knows neither offset nor scale.

    Tolerance: an offset of 1e6 against a spread of 1e-6 x scale costs digits; the test's own numbers hold 1e-16 offset.
    """
    a, b = np.random.default_rng(seed).normal(size=(2, count))
    r = pearson_correlation(a, b)
    assert r == pytest.approx(np.corrcoef(a, b)[0, 1], abs=1e-12)
    assert pearson_correlation(b, a) == pytest.approx(r, abs=1e-12)
    assert pearson_correlation(scale * a, b) == pytest.approx(r, abs=1e-12)
    assert pearson_correlation(-a, b) == pytest.approx(-r, abs=1e-12)
    assert pearson_correlation(a + offset, b) == pytest.approx(r, abs=1e-12 + 1e-13 * abs(offset))


@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize(("recorded", "simulated"), [(85e-9, 12e-9), (12e-9, 85e-9)])
def test_pulses_farther_apart_than_half_the_record_have_their_lag(recorded, simulated, noise):
    """Set-up: pulses 73 ns apart in a record of 100 ns, of 2 V, with noise.

    Expected: their distance; noise s over the peak moves it by about s tau / sqrt(samples) = 0.03 ns, of which 5.
    Half a record was tried, in which they correlate nowhere: a lag that is none was reported.
    """
    draw = np.random.default_rng(4)
    first, second = (pulse(at) + 2.0 * noise * draw.normal(size=TIME.size) for at in (recorded, simulated))
    found = compare_waveforms(TIME, first, second)
    assert found.lag == pytest.approx(recorded - simulated, abs=0.15e-9)
    assert found.best_correlation > 0.98


def test_both_conventions_of_the_peak_error():
    """Table 3 and 4 at Mach 4: 1.738 V recorded, 18.65 % off. That makes the simulated one 1.4648 V (reading 30)."""
    found = compare_waveforms(TIME, pulse(peak=1.738), pulse(peak=1.4648))
    assert found.peak_error == pytest.approx(0.1865, abs=1e-4)
    assert found.peak_error_of_recorded == pytest.approx(0.273 / 1.738, abs=1e-3)
    assert found.recorded_peak == pytest.approx(1.738) and found.simulated_peak == pytest.approx(1.4648)


@settings(max_examples=40, deadline=None)
@given(shift=st.floats(-15e-9, 15e-9), scale=st.floats(0.1, 10.0))
def test_a_shift_is_found_and_explains_a_small_correlation(shift, scale):
    """Set-up: the same pulse, later by a shift that need not be whole samples; r at zero lag falls, the best does not.

    Error sources: the parabola through three samples of a correlation of width 12 samples, (1/12)^2 x 0.03 sample; and
    r at the nearest whole shift, 1 - (0.5 / 12)^2 / 2. Tolerance 0.01 sample (5 ps) and 2e-3 in r.
    """
    found = compare_waveforms(TIME, scale * pulse(50e-9 + shift), pulse(50e-9))
    assert found.lag == pytest.approx(shift, abs=5e-12)
    assert found.best_correlation > 1.0 - 2e-3
    assert found.best_correlation >= found.correlation
    if abs(shift) > 6e-9:
        assert found.correlation < 0.7


def test_bad_waveforms_are_refused():
    with pytest.raises(ValueError, match="one length"):
        compare_waveforms(TIME, pulse()[:-1], pulse())
    with pytest.raises(ValueError, match="simulated waveform has no positive peak"):
        compare_waveforms(TIME, pulse(), -pulse() - 1.0)
    with pytest.raises(ValueError, match="constant"):
        compare_waveforms(TIME, np.ones(TIME.size), pulse())
    with pytest.raises(ValueError, match="at least 16"):
        compare_waveforms(TIME[:9], pulse()[:9], pulse()[:9])
    with pytest.raises(ValueError, match="even steps"):
        compare_waveforms(TIME**2, pulse(), pulse())
    with pytest.raises(ValueError, match="greatest_lag"):
        compare_waveforms(TIME, pulse(), pulse(), greatest_lag=0.0)


@pytest.mark.parametrize("tau", [3.6e-9, 5.9e-9, 6.2e-9, 9e-9])
def test_another_pulse_is_told_apart_however_well_it_correlates(tau):
    """Gaussians of equal peak and arrival, 6 ns and another tau.

    Formula: width at half height 2 sqrt(ln 2) tau; the leading edge there moves by c / 2 times half their difference.

    Tolerance: the quintic spline on 0.5 ns, 1e-4 of the widths.
    """
    found = compare_waveforms(TIME, pulse(tau=tau), pulse())
    fwhm = 2.0 * math.sqrt(math.log(2.0))
    assert found.recorded_width == pytest.approx(fwhm * tau, rel=1e-4)
    assert found.simulated_width == pytest.approx(fwhm * 6e-9, rel=1e-4)
    assert found.same_pulse is False and found.degree == "highly correlated"
    assert found.width_range == pytest.approx(found.range_difference * -1.0, abs=1e-4)


@pytest.mark.parametrize("noise", [0.0, 0.002, 0.02, 0.1])
def test_the_same_pulse_is_the_same_whatever_its_place_peak_and_noise(noise):
    """100 records each: no false alarm at five standard errors (6e-7 a width), and none tried in a tenth of noise."""
    random = np.random.default_rng(1)
    for _ in range(100 if noise else 1):
        recorded = pulse(50e-9 + random.uniform(-2e-9, 2e-9), random.uniform(1.0, 3.0)) + noise * random.normal(
            size=200
        )
        assert compare_waveforms(TIME, recorded, pulse()).same_pulse in ((True,) if noise < 0.03 else (True, None))


def test_another_pulse_shows_in_noise_and_by_its_tail():
    """The mean of 100 echoes with 20 mV, 2 mV: 5 % of width are 40 times that; HELIOS's tail at equal half width."""
    noise = 0.002 * np.random.default_rng(2).normal(size=TIME.size)
    assert compare_waveforms(TIME, pulse(tau=6.3e-9) + noise, pulse()).same_pulse is False
    u = np.maximum((TIME - 50e-9) / 2.943e-9 + 2.0, 0.0)
    tailed = compare_waveforms(TIME, 2.0 * 0.25 * u**2 * np.exp(2.0 - u), pulse())
    assert tailed.recorded_width == pytest.approx(tailed.simulated_width, rel=1e-3)
    assert tailed.same_pulse is False
