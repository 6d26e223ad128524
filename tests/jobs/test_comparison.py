"""Recorded echoes against runs: files with known echoes, whose peaks, lags and ranges are exact."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import xarray

from aerokernels.jobs.comparison import CompareOptions, compare_recording
from aerokernels.jobs.comparison_report import error_table, peak_table, write_comparison
from aerokernels.jobs.recorded import RecordedEcho
from aerokernels.jobs.run_folder import read_run

from .echoes_on_file import ARRIVAL, DISTANCE, LABELS, PEAKS, TAU, TIME, C, noisy, pulse, write_store


def make_run(folder: Path, mach: float, peak: float) -> Path:
    """A run's two files, as small as a comparison needs them; the leading edge walks, the other methods are exact."""
    folder.mkdir()
    time = ARRIVAL + np.arange(-150, 151) * 100e-12
    walk = 0.5 * C * TAU * (math.sqrt(math.log(2.0)) - math.sqrt(math.log(peak)))
    ranges = {
        "leading-edge": DISTANCE + walk,
        **dict.fromkeys(("constant-fraction", "centroid", "matched-filter"), DISTANCE),
    }
    summary = {"scene": f"bench-{mach:g}", "mach": mach, "true_range_m": DISTANCE, "ranges_m": ranges}
    (folder / "summary.json").write_text(json.dumps(summary))
    scene = '[flow]\nsource = "static"\n\n[detector]\nthreshold = 1.0\nfraction = 0.5\n'
    xarray.Dataset(
        {"echo_voltage": ("time", pulse(time, peak), {"units": "V"})},
        {"time": ("time", time, {"units": "s"})},
        {"scene": scene},
    ).to_netcdf(folder / "result.nc", engine="h5netcdf")
    return folder


@pytest.fixture
def runs(tmp_path: Path):
    return [read_run(str(make_run(tmp_path / f"run{mach}", mach, peak))) for mach, peak in PEAKS.items()]


def test_noise_free_echoes_are_exact(tmp_path: Path, runs):
    """Recorded 5 % higher and 0.2 ns late at Mach 3: peak error 5 %, lag 0.2 ns, ranges 30 mm long, no spread.

    Leading edge: the recorded edge at 1 V, against the simulated one. Error sources: the peak between samples (period /
    2 tau)^2 = 0.2 %; counts of 0.1 mV: 0.2 mm of range; the parabola of the lag 1e-3 samples.
    """
    late = 0.2e-9
    echoes = [
        RecordedEcho(LABELS[mach], TIME, pulse(TIME, peak * (1.05 if mach == 3 else 1.0), late if mach == 3 else 0.0))
        for mach, peak in PEAKS.items()
        for _ in range(2)
    ]
    found = compare_recording(write_store(tmp_path / "e.sqlite", echoes), runs)
    static, moving = found.labels
    assert (static.run.name, moving.run.name) == ("bench-0", "bench-3")
    assert abs(static.waveform.peak_error) < 1e-3 and static.waveform.correlation > 1.0 - 1e-6
    assert static.recorded.spread.max() < 1e-12
    assert moving.waveform.peak_error == pytest.approx(0.05, abs=3e-3)
    assert moving.waveform.lag == pytest.approx(late, abs=5e-12)
    edge = late - TAU * (math.sqrt(math.log(1.05 * 1.8)) - math.sqrt(math.log(1.8)))
    assert moving.waveform.edge_shift == pytest.approx(edge, abs=2e-12)
    walk = 0.5 * C * TAU * (math.sqrt(math.log(2.0)) - math.sqrt(math.log(1.8)))
    for method in ("constant-fraction", "centroid", "matched-filter"):
        errors = moving.ranges[method]
        assert errors.systematic_error_m == pytest.approx(0.5 * C * late, abs=3e-4), method
        assert errors.random_error_m < 1e-9 and (errors.ranged_count, errors.missed_count) == (2, 0)
    leading = moving.ranges["leading-edge"]
    assert leading.simulated_error_m == pytest.approx(walk, abs=1e-9)
    assert leading.systematic_error_m == pytest.approx(walk + 0.5 * C * edge, abs=3e-4)


def test_the_error_of_a_single_echo_is_not_known(tmp_path: Path, runs):
    """Set-up: one echo per label. Expected: no error is claimed for its peak: null in the files, words in the table."""
    echoes = [RecordedEcho(LABELS[mach], TIME, pulse(TIME, peak)) for mach, peak in PEAKS.items()]
    found = compare_recording(write_store(tmp_path / "e.sqlite", echoes), runs)
    assert all(math.isnan(one.errors.peak) and np.isnan(one.recorded.spread).all() for one in found.labels)
    assert all(row[2].endswith("error not known") for row in peak_table(found)[2])
    assert all(row[3].endswith("spread not known") for row in peak_table(found)[2])
    assert all("error not known" in row[1] for row in error_table(found)[2])
    write_comparison(found, tmp_path / "out")
    row = json.loads((tmp_path / "out" / "summary.json").read_text())["labels"][0]
    assert row["recorded_peak_standard_error_v"] is None and row["single_peak_spread_v"] is None


def test_a_run_with_noise_is_warned_of(tmp_path: Path):
    folder = make_run(tmp_path / "run", 3, PEAKS[3])
    result = xarray.load_dataset(folder / "result.nc", engine="h5netcdf")
    result.attrs["scene"] += "noise = true\n"
    result.to_netcdf(folder / "result.nc", engine="h5netcdf")
    echoes = [RecordedEcho(LABELS[3], TIME, pulse(TIME, PEAKS[3]))] * 2
    found = compare_recording(write_store(tmp_path / "e.sqlite", echoes), [read_run(str(folder))])
    assert len(found.warnings) == 1 and "detector.noise is false" in found.warnings[0]


def test_mean_spread_and_random_error_follow_the_noise(tmp_path: Path, runs):
    """400 echoes with 20 mV of noise: spread 20 mV, random range error the Cramer-Rao bound for the matched filter.

    Bound: c / 2 * noise / sqrt(sum of squared slopes). Error sources: a standard deviation of 400 is good to 3.5 %, of
    300 ranged ones to 4 %: 5 times that is allowed. The mean's error is 20 mV / 20 in each sample, 5 of them allowed.
    """
    found = compare_recording(
        write_store(tmp_path / "e.sqlite", noisy(400, 0.02)), runs, CompareOptions(ranged_count=300)
    )
    for one, peak in zip(found.labels, PEAKS.values(), strict=True):
        assert one.recorded.count == 400
        assert np.mean(one.recorded.spread) == pytest.approx(0.02, rel=0.02)
        assert np.abs(one.recorded.mean - one.simulated).max() < 5.0 * 0.001
        slope = -2.0 * (TIME - ARRIVAL) / TAU**2 * pulse(TIME, peak)
        bound = 0.5 * C * 0.02 / np.linalg.norm(slope)
        errors = one.ranges["matched-filter"]
        assert errors.ranged_count == 300
        assert errors.random_error_m == pytest.approx(bound, rel=0.2)
        assert abs(errors.systematic_error_m) < 5.0 * errors.systematic_standard_error_m + 1e-4
        assert one.echo_correlation == pytest.approx(1.0, abs=0.01)


def test_a_trigger_offset_is_taken_off_only_where_it_is_asked_for(tmp_path: Path, runs):
    """All echoes 7.3 ns late, Mach 3 another 0.1 ns: by mach=0 only the 0.1 ns are left, by each nothing."""
    echoes = [
        RecordedEcho(LABELS[mach], TIME, pulse(TIME, peak, 7.3e-9 + (0.1e-9 if mach else 0.0)))
        for mach, peak in PEAKS.items()
    ]
    path = write_store(tmp_path / "e.sqlite", echoes)
    plain, given, by_static, each = (
        compare_recording(path, runs, options).labels[1]
        for options in (
            CompareOptions(),
            CompareOptions(trigger_offset=7.3e-9),
            CompareOptions(align="mach=0"),
            CompareOptions(align="each"),
        )
    )
    assert plain.waveform.correlation < 0.2 and plain.waveform.best_correlation > 0.999
    for one in (given, by_static):
        assert one.waveform.lag == pytest.approx(0.1e-9, abs=3e-12)
        assert one.ranges["matched-filter"].systematic_error_m == pytest.approx(0.5 * C * 0.1e-9, abs=1e-3)
    assert by_static.trigger_offset == pytest.approx(7.3e-9, abs=3e-12)
    assert each.trigger_offset == pytest.approx(7.4e-9, abs=3e-12) and abs(each.waveform.lag) < 3e-12


def test_bad_runs_are_refused_by_name(tmp_path: Path):
    with pytest.raises(ValueError, match="no such folder"):
        read_run(str(tmp_path / "absent"))
    with pytest.raises(ValueError, match="holds no result"):
        read_run(str(tmp_path))
    folder = make_run(tmp_path / "run", 0.0, 2.0)
    (folder / "summary.json").write_text("{}")
    with pytest.raises(ValueError, match="cannot be read"):
        read_run(str(folder))


@pytest.mark.parametrize(
    "options",
    [
        {"align": "static"},
        {"trigger_offset": math.nan},
        {"threshold": 0.0},
        {"ranged_count": 1},
        {"trigger_offset": 1e-9, "align": "each"},
    ],
)
def test_options_that_make_no_sense(options: dict):
    with pytest.raises(ValueError, match=next(iter(options))):
        CompareOptions(**options)


def test_another_pulse_is_said_loudly(tmp_path: Path, runs, command_line):
    """Recorded pulses of tau 3.6 ns against 6 ns: they correlate highly, and their edges are 299 mm apart.

    Expected: a warning with both widths and what they do to a range, c / 2 times half of their difference; a mark at
    the degree and at the ranges read off the edge; the same in summary.json and the report. None for the run's pulse.
    """
    narrow = [RecordedEcho(LABELS[0], TIME, 2.0 * np.exp(-(((TIME - ARRIVAL) / (0.6 * TAU)) ** 2))) for _ in range(3)]
    store = write_store(tmp_path / "narrow.sqlite", narrow)
    (one,) = compare_recording(store, runs).labels
    fwhm = 2.0 * math.sqrt(math.log(2.0)) * TAU
    assert one.waveform.width_range == pytest.approx(-0.25 * C * 0.4 * fwhm, rel=1e-3)
    (text,) = one.warnings
    assert f"{0.6e9 * fwhm:.3f} ns wide" in text and "no range differences" in text and "beam.pulse_tau" in text
    assert one.row()["same_pulse"] is False
    done = command_line("compare", store, tmp_path / "run0", "--out", "found")
    assert done.returncode == 0 and text in done.stderr
    assert "highly correlated (different pulse)" in done.stdout
    assert json.loads((tmp_path / "found" / "summary.json").read_text())["warnings"] == [text]
    assert "is not the simulated one" in (tmp_path / "found" / "report.html").read_text(encoding="utf-8")
    same = [RecordedEcho(LABELS[0], TIME, pulse(TIME, 2.0, 0.0)) for _ in range(3)]
    assert compare_recording(write_store(tmp_path / "same.sqlite", same), runs).warnings == []
