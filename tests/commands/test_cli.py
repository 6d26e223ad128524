"""The command line as a user meets it, on real scenes, with real files; in a process of its own where that matters."""

import contextlib
import json
import os
import pty
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import xarray

from tests.command import command

SMALL = (
    "--rays",
    "4096",
    "--set",
    "beam.ray_count=64",
    "--set",
    "receiver.ray_count=64",
    "--set",
    "grid.spacing=0.2 mm",
)
SUMMARY_KEYS = set(
    "strehl strehl_marechal opd_rms_m boresight_rad echo_peak_w echo_peak_v range_m range_error_m ray_count "
    "evaluation_count trace_seconds total_seconds backend device precision plan error".split()
)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, subprocess.CompletedProcess[str]]:
    """A small run of the main job, done once, and what it printed."""
    folder = tmp_path_factory.mktemp("run")
    done = command(folder, "run", "wind-tunnel-mach3", "--out", "out", *SMALL)
    assert done.returncode == 0, done.stderr
    return folder / "out", done


def test_run_writes_three_files_and_nothing_else(finished):
    out, _ = finished
    assert sorted(path.name for path in out.iterdir()) == ["report.html", "result.nc", "summary.json"]
    assert [path.name for path in out.parent.iterdir()] == ["out"]


def test_summary_holds_the_contract(finished):
    summary = json.loads((finished[0] / "summary.json").read_text())
    assert set(summary) >= SUMMARY_KEYS
    assert 0.0 < summary["strehl"] <= 1.0
    assert summary["ray_count"] == 4096
    assert isinstance(summary["boresight_rad"], float)
    assert abs(summary["range_m"] - 1.5) < 0.2 and summary["range_error_m"] == pytest.approx(summary["range_m"] - 1.5)
    assert summary["evaluation_count"] > 0 and summary["total_seconds"] >= summary["trace_seconds"] > 0.0
    assert summary["seconds"].keys() >= {"prepare", "strehl", "wavefront", "fan", "echo", "total"}
    assert summary["error"]["resampling"] > 0.0


def test_result_agrees_with_the_summary(finished):
    """The OPD map is traced apart from the Strehl estimate: both describe one wavefront.

    Expected: |<exp(i k OPD)>|^2 over the map equals the estimate. Error: 4096 Sobol rays against 31 417 on a grid,
    whose rim is cut into squares (1e-3 of a ratio near 0.98); tolerance 3e-3.
    """
    summary = json.loads((finished[0] / "summary.json").read_text())
    with xarray.open_dataset(finished[0] / "result.nc", engine="h5netcdf") as result:
        opd = result["opd"].values
        opd = opd[np.isfinite(opd)]
        assert abs(np.mean(np.exp(2j * np.pi * opd / 905e-9))) ** 2 == pytest.approx(summary["strehl"], abs=3e-3)
        assert float(result["echo_voltage"].max()) == pytest.approx(summary["echo_peak_v"], rel=1e-3)
        assert all("units" in variable.attrs for variable in result.variables.values())
        assert json.loads(result.attrs["summary"])["strehl"] == summary["strehl"]


def test_without_a_terminal_the_output_is_plain_lines(finished):
    _, done = finished
    assert "\x1b" not in done.stdout + done.stderr
    table = dict(line.split("\t") for line in done.stdout.splitlines() if "\t" in line)
    assert {"Strehl ratio", "Reported range", "Echo peak voltage"} <= set(table)
    assert all(" +- " in table[row] for row in ("Strehl ratio", "Reported range", "Echo peak voltage", "OPD, rms"))


BAD_SCENES = {
    "unknown key": ('[flow]\nsource = "mach3"\n[target]\ndistence = "1.5 m"\n', "target.distence", "target.distance"),
    "unknown table": ('[flow]\nsource = "mach3"\n[tarjet]\n', "tarjet", "target"),
    "wrong unit": ('[flow]\nsource = "mach3"\n[target]\ndistance = "1.5 kg"\n', "target.distance", "m"),
    "not a number": ('[flow]\nsource = "mach3"\n[target]\ndistance = nan\n', "target.distance", "finite"),
    "no source": ("[target]\ndistance = 1.5\n", "flow", "missing"),
    "no such flow": ('[flow]\nsource = "mach9"\n', "flow.source", "mach3"),
    "not TOML": ("[flow\nsource = 3", "", "TOML"),
    "pupil ahead of the flow": (
        '[flow]\nsource = "mach3"\n[receiver]\naperture_z = "2 m"\n',
        "receiver.aperture_z",
        "give a place behind it",
    ),
}


@pytest.mark.parametrize("name", BAD_SCENES)
def test_a_bad_scene_ends_with_status_2_and_one_line(name: str, command_line, tmp_path: Path):
    text, key, remedy = BAD_SCENES[name]
    (tmp_path / "bad.toml").write_text(text)
    done = command_line("run", "bad.toml", "--out", "out")
    assert_refused(done, tmp_path, "bad.toml", key, remedy)


def assert_refused(done: subprocess.CompletedProcess[str], folder: Path, *words: str) -> None:
    """Status 2, one line on stderr but for progress, no result on stdout, no folder made."""
    assert done.returncode == 2, done.stderr
    said = [line for line in done.stderr.splitlines() if not re.match(r"[\w-]+: [a-z' ]+$", line)]  # but for progress
    assert len(said) == 1 and done.stderr.splitlines()[-1].startswith("error: "), done.stderr
    assert "\t" not in done.stdout and "wrote" not in done.stdout
    for word in words:
        assert word in done.stderr
    assert not [path for path in folder.iterdir() if path.is_dir()], "something was left behind"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run", "no-such-scene", "--out", "out"), ("no-such-scene", "wind-tunnel-mach3")),
        (("run", "wind-tunnel-mach3"), ("--out",)),
        (("run", "wind-tunnel-mach3", "--out", "out", "--set", "target.distance"), ("target.distance", "KEY=VALUE")),
        (("run", "wind-tunnel-mach3", "--out", "out", "--set", "target.tilt=5 mm"), ("target.tilt", "5 mm")),
        (("run", "wind-tunnel-mach3", "--out", "out", "--rays", "many"), ("strehl.ray_count", "many")),
        (("run", "wind-tunnel-mach3", "--out", "out", "--backend", "cray"), ("trace.backend", "warp")),
        (("run", "wind-tunnel-mach3", "--out", "out", "--device", "cuda:99"), ("cuda:99", "cpu")),
        (("run", "wind-tunnel-mach3", "--out", "file.txt/out"), ("file.txt", "choose another name")),
        (("nonsense",), ("nonsense",)),
    ],
)
def test_bad_arguments_end_with_status_2_and_one_line(arguments, words, command_line, tmp_path: Path):
    (tmp_path / "file.txt").write_text("in the way")
    assert_refused(command_line(*arguments), tmp_path, *words)


@pytest.mark.parametrize("way", ["Ctrl-C", "closes"])
def test_a_terminal_that_interrupts_or_closes_leaves_nothing(tmp_path: Path, way: str):
    """Set-up: a job on a terminal of its own, which sends Ctrl-C, or closes. Expected: status 130 or 129, no folder."""
    process, terminal = pty.fork()
    if not process:
        os.chdir(tmp_path)
        signal.signal(signal.SIGHUP, signal.SIG_DFL)  # it is ignored under nohup
        line = ["-m", "aerokernels", "run", "wind-tunnel-static", "--out", "out", "--rays", "5000000"]
        os.execv(sys.executable, [sys.executable, *line])
    seen = b""
    while b"tracing" not in seen:
        seen += os.read(terminal, 4096)
    if way == "closes":
        os.close(terminal)
    else:
        os.write(terminal, b"\x03")
        with contextlib.suppress(OSError):  # Linux says so when the last writer has left
            while more := os.read(terminal, 4096):
                seen += more
        os.close(terminal)
        assert seen.count(b"interrupted") == 1
    assert os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == (129 if way == "closes" else 130)
    assert b"Traceback" not in seen and list(tmp_path.iterdir()) == []


def test_a_terminal_sees_progress_and_a_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """On a pseudo-terminal the job draws: control sequences, each stage's name, and a table at the end."""
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("COLUMNS", "100")
    ours, theirs = pty.openpty()
    seen = bytearray()

    def listen() -> None:
        with contextlib.suppress(OSError):  # Linux's way to say that the other end is closed
            while part := os.read(ours, 65536):
                seen.extend(part)

    listening = threading.Thread(target=listen)
    listening.start()
    with open(theirs, "w", encoding="utf-8") as screen:
        done = command(tmp_path, "run", "wind-tunnel-static", "--out", "out", *SMALL, screen=screen)
    listening.join(60)
    os.close(ours)
    text = seen.decode(errors="replace")
    assert done.returncode == 0, text
    assert "\x1b[" in text and "tracing the echo" in text and "Strehl ratio" in text and "━" in text


def test_an_answer_worth_nothing_ends_with_status_3_and_its_reason(command_line, tmp_path: Path):
    """A grid of 7 mm on a shock layer of 2 mm: number, error, reason, status 3; `run` writes its files."""
    coarse = ("--set", "grid.spacing=7 mm")
    done = command_line("strehl", "wind-tunnel-mach3", "--rays", "4096", *coarse)
    assert done.returncode == 3 and done.stdout[:1] == "0", done.stdout
    assert done.stdout.endswith(", not meaningful: its error allows any ratio from 0 to 1\n"), done.stdout
    assert "not meaningful: " in done.stderr
    done = command_line("run", "wind-tunnel-mach3", "--out", "out", *SMALL, *coarse)
    assert done.returncode == 3 and "not meaningful: " in done.stderr and "Not meaningful\t" in done.stdout
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["report.html", "result.nc", "summary.json"]
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["verdict"] == "worthless" and len(summary["warnings"]) == 1
    assert abs(summary["strehl"] - 0.978) < summary["errors"]["strehl"] <= 1.0
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.index('class="alarm"') < page.index('class="answers"')


def test_explain_tells_without_tracing(command_line, tmp_path: Path):
    done = command_line("explain", "wind-tunnel-mach3", "--rays", "12345")
    assert done.returncode == 0, done.stderr
    assert "12,345" in done.stdout and "nodes" in done.stdout and "OPD" in done.stdout
    assert list(tmp_path.iterdir()) == []
