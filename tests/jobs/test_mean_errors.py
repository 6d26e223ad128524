"""Errors of a comparison against many random draws: how often they hold the exact value."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from aerokernels.jobs.comparison import CompareOptions, compare_recording
from aerokernels.jobs.comparison_report import correlation_table, error_table, notes
from aerokernels.jobs.echo_statistics import COVERAGE, average, mean_errors, mean_factor, spread_factor
from aerokernels.jobs.recorded import RecordedEcho
from aerokernels.jobs.run_folder import read_run

from .echoes_on_file import LABELS, TIME, noisy, pulse, write_store
from .test_comparison import make_run
from .test_record_faults import digitised

DRAWS = 1000
EVERY = np.ones(TIME.size, dtype=bool)


@pytest.mark.parametrize("count", [2, 3, 5, 20, 1000])
def test_factors_hold_the_mean_and_the_spread_of_normal_numbers(count: int):
    """20,000 draws: a share of 68 % is good to 0.33 %, four times which is allowed."""
    draws = np.random.default_rng(count).standard_normal((20_000, count) if count < 1000 else (2_000, count))
    spread = draws.std(axis=1, ddof=1)
    held = np.abs(draws.mean(axis=1)) < mean_factor(count) * spread / math.sqrt(count)
    allowed = 4.0 * math.sqrt(COVERAGE * (1.0 - COVERAGE) / len(draws))
    assert np.mean(held) == pytest.approx(COVERAGE, abs=allowed)
    assert np.mean(np.abs(spread - 1.0) < spread_factor(count) * spread) == pytest.approx(COVERAGE, abs=allowed)
    assert mean_factor(count) == pytest.approx(stats.t(count - 1).interval(COVERAGE)[1])
    assert math.isnan(mean_factor(1)) and math.isnan(spread_factor(1))


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
        errors = mean_errors(recorded, EVERY, TIME, exact, 1.0)
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
        assert abs(one.waveform.recorded_peak - 2.0) < 3.0 * one.peak_standard_error
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


def test_lags_and_edges_are_written_with_their_errors(tmp_path: Path):
    run = read_run(str(make_run(tmp_path / "run", 0, 2.0)))
    several, single = ([echo for echo in noisy(n, 0.02) if echo.label == LABELS[0]] for n in (20, 1))
    found = compare_recording(write_store(tmp_path / "many.sqlite", several), [run])
    (edge,), (lag,) = (
        ([row[4], row[5]] for row in error_table(found)[2]),
        ([row[4]] for row in correlation_table(found)[2]),
    )
    assert all(" +- " in text for text in (*edge, *lag))
    found = compare_recording(write_store(tmp_path / "one.sqlite", single), [run])
    (row,) = error_table(found)[2]
    assert row[4].endswith("error not known") and row[5].endswith("error not known")
