"""Single echoes that are unlike the others of their label: cut short, on other times, or without a pulse."""

from pathlib import Path

import numpy as np
import pytest

from aerokernels.hardware.frames import EchoFrame
from aerokernels.hardware.store import EchoStore
from aerokernels.jobs.comparison import compare_recording
from aerokernels.jobs.run_folder import read_run

from .echoes_on_file import PERIOD, TIME, pulse
from .test_comparison import make_run


def write(path: Path, rows: list[np.ndarray]) -> Path:
    with EchoStore(path) as store:
        store.begin_recording("p", "frames", {"mach": "0"})
        for number, volts in enumerate(rows):
            counts = np.rint(volts / 1e-4).astype(int)
            store.add(EchoFrame(number, number, round(PERIOD * 1e12), 1e-4, 0.0, counts), number)
        store.commit()
    return path


@pytest.mark.parametrize("length", [16, 85])
def test_an_echo_that_was_cut_short_does_not_decide_for_all(tmp_path: Path, length: int):
    """Set-up: the first of 31 echoes ends before the pulse (16 samples) or within it (85), the others hold it whole.

    Before, the label was refused as recorded at other times, or said to show too little of the pulse.
    """
    random, run = np.random.default_rng(1), read_run(str(make_run(tmp_path / "run", 0, 2.0)))
    rows = [pulse(TIME) + 0.02 * random.standard_normal(TIME.size) for _ in range(31)]
    rows[0] = rows[0][:length]
    (one,) = compare_recording(write(tmp_path / "e.sqlite", rows), [run]).labels
    assert one.recorded.mean.size == TIME.size and one.recorded.resampled_count == 1 and one.waveform.same_pulse
    for method, found in one.ranges.items():
        if length == 16:
            assert (found.ranged_count, found.missed_count) == (30, 1), method
        assert abs(found.systematic_error_m - found.simulated_error_m) < 0.01, method


def test_echoes_without_a_pulse_are_said_and_not_ranged(tmp_path: Path):
    """Set-up: the beam is blocked in 2 of 40 echoes. Constant fraction and centroid found a pulse in their noise.

    Expected: no method ranges them, so that the systematic error stays within 4 of its own errors (5 mm is what the
    greatest sample's noise does to the constant fraction); before it was tenths of a metre.
    """
    random, run = np.random.default_rng(2), read_run(str(make_run(tmp_path / "run", 0, 2.0)))
    rows = [(number not in (7, 20)) * pulse(TIME) + 0.02 * random.standard_normal(TIME.size) for number in range(40)]
    found = compare_recording(write(tmp_path / "e.sqlite", rows), [run])
    (one,) = found.labels
    for method, errors in one.ranges.items():
        assert (errors.ranged_count, errors.missed_count) == (38, 2), method
        off = abs(errors.systematic_error_m - errors.simulated_error_m)
        assert off < 4.0 * errors.systematic_standard_error_m + 0.005 * (method == "constant-fraction"), method
    assert one.row()["without_pulse_count"] == 2
    assert any(text.startswith("mach=0: 2 of 40 echoes have no pulse") for text in found.warnings)
