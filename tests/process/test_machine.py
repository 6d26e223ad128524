"""What a process may use: control groups as the kernel writes them, limits and bindings for real."""

import math
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from aerokernels.process import machine


def write(folder: Path, **files: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name.replace("__", ".")).write_text(text)


@pytest.fixture
def groups(tmp_path: Path, monkeypatch) -> Path:
    monkeypatch.setattr(machine, "GROUPS", tmp_path / "cgroup")
    monkeypatch.setattr(machine, "MEMBERSHIP", tmp_path / "membership")
    return tmp_path


def test_version_two_a_job_within_a_container(groups: Path):
    (groups / "membership").write_text("0::/jobs/mine\n")
    write(groups / "cgroup/jobs/mine", cpu__max="max 100000\n", memory__max="max\n", memory__current="5\n")
    write(groups / "cgroup/jobs", cpu__max="150000 100000\n", memory__max="4000000\n", memory__current="3000000\n")
    write(groups / "cgroup/jobs", memory__stat="anon 1\ninactive_file 500000\n")
    assert list(machine._core_quotas()) == [1.5]
    assert machine.host_memory() == 4e6
    assert machine.free_memory() == 4e6 - 2.5e6  # pages of files can be dropped


def test_groups_that_say_nothing_limit_nothing(groups: Path):
    (groups / "membership").write_text("0::/../../odd\n3:memory:\n")
    write(groups / "cgroup", cpu__max="max\n", memory__max="not a number\n")
    assert 1e8 < machine.free_memory() <= machine.host_memory()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="bindings and limits as Linux has them")
def test_a_shell_that_binds_and_limits():
    """`taskset` and `ulimit -v`, in a process of its own: cores and memory follow, also those of a file's reader."""
    code = (
        "import os, resource\n"
        "os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})\n"
        "resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))\n"
        "from aerokernels.process import foreign_files, machine\n"
        "print(machine.core_count(), machine.host_memory(), machine.free_memory())\n"
        "try: foreign_files.check_room(1.5e9, 'a.nc')\n"
        "except foreign_files.NoRoomError as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=True, timeout=60)
    numbers, refusal = done.stdout.splitlines()
    cores, memory, free = map(float, numbers.split())
    assert (cores, memory) == (1, 2 << 30) and 0 < free < memory < math.inf
    assert refusal.startswith("a.nc announces 1.5 GB")


@pytest.mark.skipif(not hasattr(os, "sched_setscheduler"), reason="no classes of threads here")
def test_threads_that_start_in_the_block_are_patient_and_no_others():
    held = threading.Event()

    def started() -> threading.Thread:
        thread = threading.Thread(target=held.wait)
        thread.start()
        return thread

    with machine.patient_threads():
        patient = started()
    usual = started()
    try:
        assert os.sched_getscheduler(patient.native_id) == os.SCHED_BATCH
        assert os.sched_getscheduler(usual.native_id) == os.sched_getscheduler(0) == os.SCHED_OTHER
    finally:
        held.set()
        patient.join()
        usual.join()
