"""Cut-off peaks and offsets of the voltage are said, with their numbers; whole echoes of any resolution are not."""

import csv
from pathlib import Path

import numpy as np
import pytest

from aerokernels.compare import compare_waveforms
from aerokernels.hardware.frames import EchoFrame
from aerokernels.hardware.store import EchoStore
from aerokernels.jobs.comparison import CompareOptions, compare_recording
from aerokernels.jobs.comparison_report import write_comparison
from aerokernels.jobs.run_folder import read_run

from .echoes_on_file import ARRIVAL, PERIOD, TIME, pulse
from .test_comparison import make_run


def digitised(path: Path, *, bits: int, greatest: float, noise: float, offset: float = 0.0, count: int = 10) -> Path:
    """Write a store of echoes with a peak of 2 V and an offset, as a digitiser of +-`greatest` volts records them."""
    random, step, half = np.random.default_rng(3), 2.0 * greatest / 2**bits, 2 ** (bits - 1)
    with EchoStore(path) as store:
        store.begin_recording("p", "frames", {"mach": "0"})
        for number in range(count):
            volts = pulse(TIME) + offset + noise * random.standard_normal(TIME.size)
            counts = np.clip(np.rint(volts / step), -half, half - 1).astype(int)
            store.add(EchoFrame(number, number, round(PERIOD * 1e12), step, 0.0, counts), number)
        store.commit()
    return path


@pytest.fixture
def run(tmp_path: Path):
    return read_run(str(make_run(tmp_path / "run", 0, 2.0)))


@pytest.mark.parametrize(("noise", "greatest"), [(0.0, 1.9), (0.02, 1.2)])
def test_a_peak_that_is_cut_off_is_said_to_be_that(tmp_path: Path, run, noise: float, greatest: float):
    """Before, the advice was to put another pulse into the scene, and the peak had an error "below rounding"."""
    path = digitised(tmp_path / "e.sqlite", bits=12, greatest=greatest, noise=noise)
    found = compare_recording(path, [run])
    assert found.labels[0].faults.cut_off_share == 1.0
    (text,) = found.warnings
    assert text.startswith(f"mach=0: the peak of 100 % of the echoes is cut off at {greatest - greatest / 2048:.4g} V")


@pytest.mark.parametrize(("noise", "count"), [(0.0, 1), (0.0, 10), (0.005, 10)])
def test_a_coarse_digitiser_makes_no_other_pulse(tmp_path: Path, run, noise: float, count: int):
    """Eight bits of which the pulse uses 29 counts: rounding moves its widths by more than a hundredth.

    Before, the recorded pulse was said not to be the simulated one. Another pulse is still told apart.
    """
    path = digitised(tmp_path / "e.sqlite", bits=8, greatest=8.8, noise=noise, count=count)
    found = compare_recording(path, [run])
    assert found.labels[0].waveform.same_pulse and not found.warnings
    mean, time, simulated = found.labels[0].recorded.mean, found.labels[0].recorded.time, found.labels[0].simulated
    step = found.labels[0].recorded.step
    wider = np.interp(time, ARRIVAL + 1.2 * (time - ARRIVAL), simulated)
    assert compare_waveforms(time, mean, wider, rounding=0.5 * step).same_pulse is False
    with pytest.raises(ValueError, match="rounding must be finite and at least 0"):
        compare_waveforms(time, mean, simulated, rounding=-1.0)


@pytest.mark.parametrize("offset", [-0.05, 0.005])
def test_an_offset_is_measured_and_can_be_subtracted(tmp_path: Path, run, offset: float):
    """5 mV of 2 V move the leading edge by 1 mm, and 50 mV by 13 mm of range, without a change of the target."""
    path = digitised(tmp_path / "e.sqlite", bits=14, greatest=3.0, noise=0.02, offset=offset, count=50)
    (one,) = compare_recording(path, [run]).labels
    assert abs(one.faults.offset - offset) < 4.0 * one.faults.offset_error < 4.0 * 0.001
    (text,) = one.warnings
    assert f"mach=0: the recorded voltage has an offset, {1e3 * one.faults.offset:+.2f} +- 0." in text
    assert "as voltage offset" in text
    found = compare_recording(path, [run], CompareOptions(voltage_offset=offset))
    assert not found.warnings
    edge = found.labels[0].ranges["leading-edge"]
    assert abs(edge.systematic_error_m - edge.simulated_error_m) < 4.0 * edge.systematic_standard_error_m
    write_comparison(found, tmp_path / "out")
    with (tmp_path / "out" / "compare.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert abs(float(row["offset_v"])) < 4.0 * float(row["offset_standard_error_v"]) and row["cut_off_share"] == "0.0"
    assert f"{1e3 * offset:g} mV were subtracted" in (tmp_path / "out" / "report.html").read_text()
