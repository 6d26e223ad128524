"""Sweeps as a user meets them: processes that are killed, goings-on, failures, refusals."""

import itertools
import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
import xarray

import aerokernels
from aerokernels.jobs.sweeps.records import CASES_FILE, DATASET_FILE, Records
from tests.command import command

SMALL = {
    "strehl.ray_count": "1024",
    "beam.ray_count": "16",
    "receiver.ray_count": "16",
    "receiver.return_factor": "none",
    "grid.spacing": "0.4 mm",
}
OPTIONS = [part for key, value in SMALL.items() for part in ("--set", f"{key}={value}")]
# Two index fields of air at rest: a shipped flow takes each worker two seconds.
VARY = ["--vary", "flow.wavelength=905 nm,1064 nm", "--vary", "target.tilt=0 deg:15 deg:4"]
COMMAND = ["sweep", "wind-tunnel-static", *VARY, *OPTIONS, "--out", "out"]


def started(folder: Path, *arguments: str) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-m", "aerokernels", *arguments],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
    )


def lines(folder: Path) -> list[dict]:
    path = folder / "out" / CASES_FILE
    whole = path.read_text().rpartition("\n")[0] if path.is_file() else ""  # the last line may be being written
    return [json.loads(line) for line in whole.splitlines()]


def wait_for_cases(process: subprocess.Popen, folder: Path, count: int) -> None:
    deadline = time.monotonic() + 400.0
    while len(lines(folder)) < count:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.02)


def children(pid: int, words: str) -> list[int]:
    """Processes below one whose command line holds these words."""
    found = []
    listed = [path.read_text().split() for path in Path(f"/proc/{pid}/task").glob("*/children")]
    for child in map(int, itertools.chain.from_iterable(listed)):
        with open(f"/proc/{child}/cmdline") as file:
            if words in file.read().replace("\0", " "):
                found.append(child)
        found += children(child, words)
    return found


def checked(folder: Path) -> xarray.Dataset:
    """The dataset of the 8 cases: all there, none computed twice."""
    assert sorted(line["case"] for line in lines(folder)) == list(range(8))
    with xarray.open_dataset(folder / "out" / DATASET_FILE, engine="h5netcdf") as found:
        found.load()
    assert dict(found.strehl.sizes) == {"flow.wavelength": 2, "target.tilt": 4}
    np.testing.assert_allclose(np.degrees(found["target.tilt"]), [0, 5, 10, 15], atol=1e-12)
    assert found["target.tilt"].attrs["units"] == "rad"
    assert np.isfinite(found.strehl).all() and not found.failed.any()
    return found


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, xarray.Dataset]:
    """The 8 cases, by two local workers, of which one is killed at the second case and replaced."""
    folder, add, killed = tmp_path_factory.mktemp("sweep"), Records.add, []

    def add_and_kill(records: Records, case: int, outcome: dict) -> bool:
        is_new = add(records, case, outcome)
        if len(records.done) == 2 and not killed:
            killed.extend(children(os.getpid(), "spawn_main"))
            os.kill(killed[0], signal.SIGKILL)
        return is_new

    with mock.patch.object(Records, "add", add_and_kill):
        done = command(folder, *COMMAND, "--workers", "2")
    assert done.returncode == 0 and len(killed) == 2, done.stderr
    assert "8 of 8 cases" in done.stdout and "left" in done.stderr
    return folder, checked(folder)


def test_a_finished_sweep_does_nothing(unbroken, monkeypatch: pytest.MonkeyPatch):
    folder, found = unbroken
    before = {path: path.stat().st_mtime_ns for path in (folder / "out").iterdir()}
    done = command(folder, *COMMAND)
    assert done.returncode == 0 and "nothing to do" in done.stderr
    assert {path: path.stat().st_mtime_ns for path in (folder / "out").iterdir()} == before
    monkeypatch.setattr("aerokernels.jobs.sweeps.run.run_sweep", None)  # in Python: neither
    again = aerokernels.sweep(
        "wind-tunnel-static",
        {"flow.wavelength": [905e-9, 1064e-9], "target.tilt": [0.0, *found["target.tilt"].values[1:]]},
        settings=SMALL,
        out=folder / "out",
    )
    assert again.equals(found)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (["--set", "target.distance=2 m"], ("target.distance", "1.5", "out=")),
        (["--vary", "target.width=100 mm,120 mm"], ("target.width", "out=")),
        (["--zip"], ("zip",)),
    ],
)
def test_a_changed_sweep_is_refused(unbroken, change, words, command_line):
    folder, _ = unbroken
    before = (folder / "out" / CASES_FILE).read_bytes()
    done = command_line(*COMMAND, *change, "--out", folder / "out")
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and done.stderr.startswith("error: ")
    for word in words:
        assert word in done.stderr
    assert (folder / "out" / CASES_FILE).read_bytes() == before


@pytest.mark.slow
def test_killed_in_the_middle_it_goes_on(unbroken, tmp_path: Path):
    """SIGKILL after a few cases, then the same command: what was done stays, byte for byte, and the numbers agree."""
    process = started(tmp_path, *COMMAND, "--workers", "1")
    wait_for_cases(process, tmp_path, 3)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    before = (tmp_path / "out" / CASES_FILE).read_bytes()
    assert 3 <= before.count(b"\n") < 8 and not (tmp_path / "out" / DATASET_FILE).exists()
    with (tmp_path / "out" / CASES_FILE).open("ab") as file:
        file.write(b'{"case": 7, "summary": {"stre')  # as if it had died while writing
    process = started(tmp_path, *COMMAND, "--workers", "1")
    _, faults = process.communicate(timeout=300)
    assert process.returncode == 0, faults
    assert (tmp_path / "out" / CASES_FILE).read_bytes().startswith(before)
    found, whole = checked(tmp_path), unbroken[1]
    for name in ("strehl", "opd_rms_m", "range_m", "echo_peak_v", "strehl_error"):
        np.testing.assert_array_equal(found[name], whole[name])


@pytest.mark.slow
def test_a_dead_dask_worker_is_made_up_for(unbroken, command_line, tmp_path: Path):
    """Two Dask worker processes, one of them killed in the middle; run again, it does nothing."""
    pytest.importorskip("distributed")
    dask = "--executor", "dask", "--workers", "2"
    process = started(tmp_path, *COMMAND, *dask)
    wait_for_cases(process, tmp_path, 2)
    workers = children(process.pid, "spawn_main")
    assert len(workers) == 2
    os.kill(workers[0], signal.SIGKILL)
    _, faults = process.communicate(timeout=300)
    assert process.returncode == 0, faults
    np.testing.assert_array_equal(checked(tmp_path).range_m, unbroken[1].range_m)
    assert "nothing to do" in command_line(*COMMAND, *dask).stderr


def test_a_failed_case_is_recorded_and_the_others_go_on(tmp_path: Path):
    """A target nearer than the receiver is wide; the zip's second case. In Python, with a scene and keys in SI."""
    scene = aerokernels.Scene.load("wind-tunnel-static", SMALL)
    vary = {"target.distance": [1.5, 0.01], "target.tilt": [0.0, 0.1]}
    steps: list[tuple[str, float]] = []
    with ThreadPoolExecutor(1) as here:
        found = aerokernels.sweep(
            scene, vary, out=tmp_path / "out", zip=True, executor=here,
            progress=lambda text, share: steps.append((text, share)),
        )  # fmt: skip
    assert found.strehl.dims == ("case",) and list(found["target.distance"].values) == [1.5, 0.01]
    assert list(found.failed.values) == [False, True] and found.attrs["failed_count"] == 1
    assert "target" in str(found.failures.values[1]) and np.isnan(found.range_m.values[1])
    assert np.isfinite(found.range_m.values[0]) and str(found.failures.values[0]) == ""
    assert steps[-1][1] == 1.0 and any("1 failed" in text for text, _ in steps)
    before = (tmp_path / "out" / CASES_FILE).read_bytes()
    aerokernels.sweep(scene, vary, out=tmp_path / "out", zip=True)
    assert (tmp_path / "out" / CASES_FILE).read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--vary", "target.titl=1,2"], ("target.titl", "target.tilt")),
        (["--vary", "target.tilt=1 kg,2 deg"], ("target.tilt", "deg")),
        (["--vary", "flow.source=mach2,mach7"], ("flow.source", "mach7", "mach3")),
        (["--vary", "target.tilt"], ("--vary", "KEY=V1,V2")),
        (["--vary", "target.tilt=1,2", "--executor", "slurm"], ("slurm", "dask")),
        (["--vary", "target.tilt=1,2", "--scheduler", "tcp://x:1"], ("scheduler", "executor dask")),
        (["--vary", "target.tilt=1,1.2", "--device", "cuda:77"], ("cuda:77", "trace.device")),
    ],
)
def test_bad_input_ends_with_status_2_and_writes_nothing(arguments, words, command_line, tmp_path: Path):
    done = command_line("sweep", "wind-tunnel-mach3", *arguments, "--out", "out")
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and done.stderr.startswith("error: "), done.stderr
    for word in words:
        assert word in done.stderr
    assert not list(tmp_path.iterdir())
