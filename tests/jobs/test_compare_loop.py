"""The whole loop on one machine: board -> record at three labels -> compare with three wind-tunnel runs."""

import csv
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from aerokernels.jobs.run import simulate
from aerokernels.jobs.store import RESULT_FILE, SUMMARY_FILE, staged_folder, write_result, write_summary
from aerokernels.scene import Scene

pytestmark = pytest.mark.slow

SCENES = {"0": "wind-tunnel-static", "2": "wind-tunnel-mach2", "3": "wind-tunnel-mach3"}
SMALL = {"strehl.ray_count": 1024, "beam.ray_count": 32, "receiver.ray_count": 32, "grid.spacing": "0.5 mm"}
ECHOES, NOISE = 60, 0.02


@contextmanager
def board(*arguments: object) -> Iterator[None]:
    """A simulated board in a process of its own, as a user starts it in a second terminal."""
    command = [sys.executable, "-m", "aerokernels", "board", *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, encoding="utf-8") as process:
        try:
            assert process.stdout is not None and "board on" in process.stdout.readline()
            yield
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(30)


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="this system has no pseudo-terminals")
def test_board_record_compare(tmp_path: Path, aerokernels, command_line):
    """Tables 3, 4 and 6 for this bench, whose echoes are the simulated ones with 20 mV of noise.

    Expected: peaks of the mean of 60 echoes within 5 standard errors (2.6 mV each), and the greatest of some ten
    samples near the top is higher by two of them: 1 %; r above 0.9999; each label against its own run; systematic
    range errors of the matched filter those of the run within 5 standard errors.
    """
    folders = {}
    for mach, name in SCENES.items():
        folders[mach] = tmp_path / name
        result = simulate(Scene.load(name, SMALL))
        with staged_folder(folders[mach]) as folder:  # what a run writes, less its report
            write_result(folder / RESULT_FILE, result.to_xarray())
            write_summary(folder / SUMMARY_FILE, result.summary)
    for mach, folder in folders.items():
        port = tmp_path / "port"
        with board("--link", port, "--echo", folder / "result.nc", "--rate", 1000, "--noise", NOISE, "--seed", mach):
            recorder = aerokernels if mach == "0" else command_line  # once in a process of its own
            done = recorder(
                "record", "--port", port, "--store", "echoes.sqlite", "--count", ECHOES, "--label", f"mach={mach}"
            )
            assert done.returncode == 0, done.stderr
    done = command_line("compare", "echoes.sqlite", *folders.values(), "--out", "compared")
    assert done.returncode == 0, done.stderr
    for words in ("Table 3", "Table 4", "Table 6"):
        assert words in (tmp_path / "compared" / "report.html").read_text(encoding="utf-8")
    with (tmp_path / "compared" / "compare.csv").open() as file:
        rows = {row["label"].removeprefix("mach="): row for row in csv.DictReader(file)}
    assert list(rows) == list(SCENES)
    for mach, row in rows.items():
        assert row["run"] == f"{SCENES[mach]}-changed" and int(row["echo_count"]) == ECHOES
        assert abs(float(row["peak_error"])) < 0.01
        assert float(row["correlation"]) > 0.9999 and row["degree"] == "highly correlated"
        off = float(row["matched_filter_systematic_error_m"]) - float(row["matched_filter_simulated_error_m"])
        assert abs(off) < 5.0 * float(row["matched_filter_systematic_standard_error_m"])
        assert int(row["matched_filter_ranged_count"]) == ECHOES
    peaks = {mach: float(row["simulated_peak_v"]) for mach, row in rows.items()}
    assert peaks["0"] > max(peaks[mach] for mach in "23")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("absent.sqlite", "run"), ("run", "no such folder")),
        (("absent.sqlite",), ("RUN",)),
        (("absent.sqlite", "run", "--align", "peak"), ("align", "mach=0")),
        (("absent.sqlite", "run", "--trigger-offset", "3 m"), ("3 m", "time")),
        (("absent.sqlite", "run", "--ranged", "1"), ("ranged_count", "2")),
    ],
)
def test_bad_input_ends_with_status_2_and_one_line(command_line, tmp_path: Path, arguments: tuple, words: tuple):
    done = command_line("compare", *arguments, "--out", "out")
    assert done.returncode == 2, done
    assert done.stderr.count("\n") == 1 and all(word in done.stderr for word in words), done.stderr
    assert list(tmp_path.iterdir()) == []
