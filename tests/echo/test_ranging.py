"""Range from a waveform: exact arrivals, range walk, what is refused."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerokernels import estimate_range, range_statistics
from aerokernels.lidar import RANGING_METHODS, cramer_rao_range
from aerokernels.lidar.pulses import SPEED_OF_LIGHT
from aerokernels.lidar.range_error import summarise_ranges

TAU = 6e-9
TABLE_3 = {0: 2.019, 2: 1.878, 3: 1.809, 4: 1.738}  # Mach number: peak [V]
NANOSECOND = 1e-9


def pulse(time):
    return np.exp(-((np.asarray(time) / TAU) ** 2))


def record(arrival=10e-9, peak=2.0, rate=1e9, start=-40e-9, stop=60e-9):
    time = np.arange(start, stop, 1.0 / rate)
    return time, peak * pulse(time - arrival)


def options(method):
    return {"threshold": 1.0, "template": pulse if method == "matched-filter" else None}


@pytest.mark.parametrize("rate", [0.7e9, 1e9, 10e9])
def test_leading_edge_range_walk_on_table_3(rate):
    """Set-up: Gaussian echoes of Table 3's peaks, tau 6 ns, threshold 1 V, samples as coarse as 1.4 ns.

    Formula: the crossing is at t0 - tau sqrt(ln(V / 1 V)), so the range walks by c tau / 2 times the change of that.
    Expected (reading 29): +40, +61, +85 mm from static to Mach 2, 3, 4. Error source: the quintic between samples,
    (1.4 / 6)^6 / 6! x H6 = 3e-5 V / slope 0.24 V/ns = 0.1 ps. Tolerance 0.05 mm on the formula.
    """
    walk = {}
    for mach, peak in TABLE_3.items():
        reading = estimate_range(*record(peak=peak, rate=rate), "leading-edge", threshold=1.0)
        exact = 0.5 * SPEED_OF_LIGHT * (10e-9 - TAU * math.sqrt(math.log(peak)))
        assert abs(reading - exact) < 5e-5
        walk[mach] = reading
    shifts = [1e3 * (walk[mach] - walk[0]) for mach in (2, 3, 4)]
    assert [round(shift) for shift in shifts] == [40, 61, 85]


@pytest.mark.parametrize("method", RANGING_METHODS[1:])
@pytest.mark.parametrize("rate", [0.7e9, 1e9, 10e9])
def test_the_other_methods_do_not_walk(method, rate):
    """They see the shape only; scaling it changes rounding and nothing else. Reading 29 asks for 0.5 mm.

    Tolerance: a maximum is found to the root of the rounding error, 1e-8 tau or 10 nm for the matched filter: 100 nm.
    """
    readings = [estimate_range(*record(peak=peak, rate=rate), method, **options(method)) for peak in TABLE_3.values()]
    assert np.ptp(readings) < 1e-7


@settings(max_examples=60, deadline=None)
@given(arrival=st.floats(-5e-9, 25e-9), peak=st.floats(1.2, 50.0), rate=st.floats(0.7e9, 8e9))
def test_arrival_is_exact_between_samples(arrival, peak, rate):
    """A Gaussian's crossings, centroid and match are known in closed form, wherever the samples fall.

    Tolerance 0.3 mm: the quintic at 1.4 ns samples errs by 3e-5 of the peak, which near the peak (peak barely above the
    threshold: 1.2 V, slope 0.28 of V / tau) is 0.6 ps, 0.1 mm; the centroid's cut at a tenth moves with the same error.
    """
    time, volts = record(arrival, peak, rate)
    exact = {
        "leading-edge": arrival - TAU * math.sqrt(math.log(peak)),
        "constant-fraction": arrival - TAU * math.sqrt(math.log(2.0)),
        "centroid": arrival,
        "matched-filter": arrival,
    }
    for method, moment in exact.items():
        reading = estimate_range(time, volts, method, **options(method))
        assert abs(reading - 0.5 * SPEED_OF_LIGHT * moment) < 3e-4, method


@pytest.mark.parametrize("method", ["constant-fraction", "centroid", "matched-filter"])
@pytest.mark.parametrize("sampled", [False, True])
def test_a_template_makes_its_zero_the_arrival(method, sampled):
    """Set-up: an asymmetric pulse, (1 + t/a) e^(-t/a) from t = -a on, whose peak is at t = 0.

    Each method errs on it by an offset of its own; with the template every one reads the peak's time, 10 ns. Error
    source: the pulse's corner at its foot, where its slope jumps and the spline rings. Tolerance 0.5 mm.
    """
    period = 0.25e-9

    def skew(t):
        x = np.maximum(np.asarray(t) / 8e-9 + 1.0, 0.0)
        return x**3 * np.exp(3.0 * (1.0 - x))

    time = np.arange(-200, 400) * period
    volts = 1.7 * skew(time - 10.1e-9)
    template = skew(np.arange(-80, 300) * period) if sampled else skew
    reading = estimate_range(time, volts, method, template=template, fraction=0.4)
    assert abs(reading - 0.5 * SPEED_OF_LIGHT * 10.1e-9) < 5e-4
    if method != "matched-filter":
        bare = estimate_range(time, volts, method, fraction=0.4)
        assert abs(bare - reading) > 0.05


def test_a_peak_between_samples_still_crosses():
    """Samples at +-0.5 ns of the peak show 1.986 V; 1.99 V is crossed between them, at the exact place."""
    time, volts = record(arrival=10.5e-9)
    assert volts.max() < 1.99
    exact = 10.5e-9 - TAU * math.sqrt(math.log(2.0 / 1.99))
    assert abs(estimate_range(time, volts, "leading-edge", threshold=1.99) - 0.5 * SPEED_OF_LIGHT * exact) < 1e-3


@pytest.mark.parametrize(
    ("method", "extra", "words"),
    [
        ("leading-edge", {}, "needs a threshold"),
        ("leading-edge", {"threshold": -1.0}, "threshold must be positive"),
        ("matched-filter", {}, "needs a template"),
        ("matched-filter", {"template": [0.0, -1.0, -2.0, 0.0]}, "positive peak"),
        ("matched-filter", {"template": lambda t: 1.0}, "one finite value"),
        ("constant-fraction", {"fraction": 1.0}, "fraction must lie between 0 and 1"),
        ("edge", {}, "choose one of leading-edge"),
    ],
)
def test_bad_arguments_are_refused(method, extra, words):
    with pytest.raises(ValueError, match=words):
        estimate_range(*record(), method, **extra)


@pytest.mark.parametrize("method", RANGING_METHODS)
def test_bad_waveforms_are_refused(method):
    time, volts = record()
    extra = options(method)
    with pytest.raises(ValueError, match="even steps"):
        estimate_range(np.where(time > 0, time + 0.1e-9, time), volts, method, **extra)
    with pytest.raises(ValueError, match="must increase"):
        estimate_range(time[::-1], volts, method, **extra)
    with pytest.raises(ValueError, match="one length"):
        estimate_range(time[:-1], volts, method, **extra)
    with pytest.raises(ValueError, match="not finite"):
        estimate_range(time, np.where(time > 0, np.nan, volts), method, **extra)
    with pytest.raises(ValueError, match="at least 4 samples"):
        estimate_range(time[:3], volts[:3], method, **extra)


@pytest.mark.parametrize(
    ("method", "words"),
    [
        ("leading-edge", "never crosses"),
        ("constant-fraction", "sign"),
        ("centroid", "sign"),
        ("matched-filter", "sign"),
    ],
)
def test_a_signal_of_the_wrong_sign_is_refused(method, words):
    time, volts = record()
    with pytest.raises(ValueError, match=words):
        estimate_range(time, -volts - 1e-3, method, **options(method))


def test_a_cut_record_is_refused():
    time, volts = record()
    with pytest.raises(ValueError, match="above the threshold of 1 V already"):
        estimate_range(time[48:], volts[48:], "leading-edge", threshold=1.0)
    with pytest.raises(ValueError, match="record from before the pulse to after it"):
        estimate_range(time[:50], volts[:50], "constant-fraction")
    with pytest.raises(ValueError, match="within the pulse"):
        estimate_range(time[48:], volts[48:], "constant-fraction")


def test_cramer_rao_bound_of_a_gaussian():
    """Set-up: Gaussian pulse of peak V, tau, samples every h, noise s.

    Formula: the sum of (dv/dt)^2 is V^2 sqrt(pi / 2) / (tau h), so the bound is c/2 s / V sqrt(tau h) (2 / pi)^(1/4).
    Error sources: the sum for the integral is exact to rounding at 6 samples a tau; the quintic's slope is good to
    (1 / 6)^5 x H6 / 6! = 2e-5 of the peak slope, of both signs. Tolerance 1e-4.
    """
    time, volts = record()
    expected = 0.5 * SPEED_OF_LIGHT * 0.02 / 2.0 * math.sqrt(TAU * NANOSECOND) * (2.0 / math.pi) ** 0.25
    assert abs(cramer_rao_range(time, volts, 0.02) / expected - 1.0) < 1e-4


def test_matched_filter_reaches_the_bound_and_none_beats_it():
    """Set-up: 200 noisy echoes at 40 dB, seed 3.

    Expected: the matched filter's deviation equals the bound; sampling error 1 / sqrt(2 x 200) = 5 %, so 4 of these.
    The others stay above the bound less the same allowance. Biases are below 5 standard errors plus second order in the
    noise (s / V)^2 c tau / 2 = 0.1 mm.
    """
    time, volts = record()
    for method in RANGING_METHODS:
        found = range_statistics(time, volts, method, noise_rms=0.02, trial_count=200, seed=3, **options(method))
        ratio = found.random_error / found.cramer_rao_bound
        assert ratio > 1.0 - 4 * 0.05, method
        if method == "matched-filter":
            assert ratio < 1.0 + 4 * 0.05
        assert abs(found.systematic_error) < 5.0 * found.systematic_standard_error + 1e-4
        assert found.missed_count == 0 and found.trial_count == 200


def test_confidence_intervals_cover_as_often_as_they_say():
    """Set-up: 400 samples of 12 normal numbers of mean 3 and deviation 2.

    Expected: 80 % of the intervals of each kind hold the truth, +-4 x sqrt(0.8 x 0.2 / 400) = 8 %. Student's and the
    chi-squared intervals are exact for normal numbers, however few.
    """
    generator = np.random.default_rng(8)
    held = np.zeros((400, 2), dtype=bool)
    for row in held:
        found = summarise_ranges(lambda: np.empty(0), lambda _: generator.normal(3.0, 2.0), 12, 3.0, 1.0, 0.8)
        row[0] = found.systematic_interval[0] < 0.0 < found.systematic_interval[1]
        row[1] = found.random_interval[0] < 2.0 < found.random_interval[1]
    assert np.abs(held.mean(axis=0) - 0.8).max() < 0.08


def test_rounding_is_no_correlation():
    """A record of the wrong sign, long against the template: the sum is 0 but for rounding, far from the pulse."""
    time = np.arange(801) * 1e-9
    signal, template = np.exp(-(((time - 4e-7) / 4e-8) ** 2)), np.exp(-((np.arange(-240, 241) / 40.0) ** 2))
    with pytest.raises(ValueError, match="no positive correlation"):
        estimate_range(time, -signal, "matched-filter", template=template)


@pytest.mark.parametrize("rate", [0.1e9, 0.15e9, 0.3e9])
def test_matched_filter_is_exact_with_less_than_two_samples_a_tau(rate):
    """0.6 to 1.8 samples a tau: any arrival between the samples is read within 1e-6 of c tau / 2.

    Without the template's own norm, which changes as it moves between such samples, it is 0.3 off.
    """
    for arrival in np.linspace(0.0, 1.0 / rate, 7):
        time, voltage = record(arrival=arrival, rate=rate, start=-6.0 * TAU - 2.0 / rate, stop=7.0 * TAU + 3.0 / rate)
        found = estimate_range(time, voltage, "matched-filter", template=pulse)
        assert abs(found - 0.5 * SPEED_OF_LIGHT * arrival) < 1e-6 * 0.5 * SPEED_OF_LIGHT * TAU


@pytest.mark.parametrize("method", ["centroid", "matched-filter"])
@pytest.mark.parametrize(("start", "stop", "words"), [(8e-9, 60e-9, "within the pulse"), (-40e-9, 13e-9, "within")])
def test_a_record_that_cuts_its_pulse_is_refused(method, start, stop, words):
    """What is there of the pulse has another centroid, and matches best elsewhere: by 0.1 to 0.3 m."""
    with pytest.raises(ValueError, match=words):
        estimate_range(*record(rate=10e9, start=start, stop=stop), method, **options(method))


def test_an_offset_is_told_where_it_would_move_the_centroid():
    """A fifth of the peak under a record of 100 ns moved it by metres."""
    time, voltage = record(rate=10e9)
    with pytest.raises(ValueError, match="remove its offset"):
        estimate_range(time, voltage + 0.4, "centroid")
