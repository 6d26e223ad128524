"""Errors of a comparison against many random draws: how often they hold the exact value."""

import math
from pathlib import Path

import numpy as np
import pytest

from aerokernels.jobs.comparison import CompareOptions, compare_recording
from aerokernels.jobs.comparison_report import notes
from aerokernels.jobs.echo_statistics import average, mean_errors
from aerokernels.jobs.recorded import RecordedEcho
from aerokernels.jobs.run_folder import read_run

from .echoes_on_file import TIME, noisy, pulse, write_store
from .test_comparison import make_run
from .test_record_faults import digitised

DRAWS = 1000


@pytest.mark.parametrize("count", [2, 3, 20])
def test_errors_of_the_mean_hold_the_exact_values(count: int):
    """Set-up: 1000 means of echoes of 2 V with 20 mV of noise. Exact: the pulse's own peak and its edge at 1 V.

    Expected: held in 68 % of the draws, and twice the error in 95 % of them for twenty echoes; more for the peak of few
    echoes, whose error has the mean excess of a greatest sample beside its own. Allowed: 5 %, three deviations of the
    share. Two echoes have a spread of one degree of freedom: twice their error holds 82 %.
    """
    random, exact = np.random.default_rng(count), pulse(TIME)
    peaks, edges, lags = [], [], []
    slope = np.gradient(exact, TIME)
    for _ in range(DRAWS):
        volts = exact + 0.02 * random.standard_normal((count, TIME.size))
        recorded = average(RecordedEcho((), TIME, one) for one in volts)
        errors = mean_errors(recorded, exact, 1.0)
        at = int(np.flatnonzero(recorded.mean > 1.0)[0])
        late = (exact - recorded.mean)[at] / slope[at]  # of the edge's first sample
        best = (slope @ (exact - recorded.mean)) / (slope @ slope)  # the shift that fits best
        peaks.append((recorded.mean.max() - exact.max()) / errors.peak)
        edges.append(late / errors.edge_shift)
        lags.append(best / errors.lag)
    for what, least, most in ((peaks, 0.63, 0.87), (edges, 0.60, 0.76), (lags, 0.58, 0.76)):
        assert least < np.mean(np.abs(what) < 1.0) < most
    if count == 20:
        assert all(np.mean(np.abs(what) < 2.0) > 0.9 for what in (peaks, edges, lags))


def test_the_rounding_of_a_coarse_digitiser_is_in_the_errors(tmp_path: Path):
    """An eight-bit digitiser (17 mV) with 1 mV of noise: errors of peak and ranges were 0.00 where 1.6 mm are wrong."""
    run = read_run(str(make_run(tmp_path / "run", 0, 2.0)))
    for noise in (0.001, 0.02):
        path = digitised(tmp_path / f"{noise}.sqlite", bits=8, greatest=2.2, noise=noise)
        (one,) = compare_recording(path, [run]).labels
        assert one.recorded.step == pytest.approx(4.4 / 256, rel=1e-6)
        assert abs(one.waveform.recorded_peak - 2.0) < 3.0 * one.errors.peak
        for method, found in one.ranges.items():
            if method != "constant-fraction":  # which reads long in noise
                wrong = abs(found.systematic_error_m - found.simulated_error_m)
                assert wrong < 3.0 * found.systematic_standard_error_m < 0.01, method
        left = 2.0 * one.recorded.rounding / one.recorded.step
        assert left > 0.5 if noise < 0.01 else left < 1e-6  # 20 mV of noise average it out


def test_a_measured_trigger_offset_has_an_error_that_the_ranges_share(tmp_path: Path):
    """The lag of 20 echoes is known to a few ps; that error is in every range that was calibrated with it."""
    runs = [read_run(str(make_run(tmp_path / f"run{mach}", mach, peak))) for mach, peak in ((0, 2.0), (3, 1.8))]
    path = write_store(tmp_path / "e.sqlite", noisy(20, 0.02, late=7.3e-9))
    plain = compare_recording(path, runs, CompareOptions(trigger_offset=7.3e-9))
    found = compare_recording(path, runs, CompareOptions(align="mach=0"))
    for before, after in zip(plain.labels, found.labels, strict=True):
        error = after.trigger_offset_error
        assert before.trigger_offset_error == 0.0 and 1e-12 < error < 3e-12
        assert abs(after.trigger_offset - 7.3e-9) < 4.0 * error
        one, other = (label.ranges["matched-filter"].systematic_standard_error_m for label in (before, after))
        assert other == pytest.approx(math.hypot(one, 0.5 * 299_792_458.0 * error), rel=1e-3)
        assert after.errors.lag == pytest.approx(math.hypot(before.errors.lag, error), rel=1e-3)
    assert any("mach=0 7.3" in line and " +- 0.00" in line for line in notes(found))
    assert any("mach=0 7.3 ns" in line for line in notes(plain))
