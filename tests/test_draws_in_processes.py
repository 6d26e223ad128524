"""Draws shared over processes: every seed is drawn once; what fails, ends or hangs is a fault of its seed."""

import os
import signal
import time
from pathlib import Path

import pytest

from aerokernels.process import fragile
from aerokernels.validation import draws_in_processes, forked_readers
from aerokernels.validation.draws_in_processes import Report, share

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")


def _draw(kind: str, seeds: range, folder: Path, report: Report) -> None:
    for seed in seeds:
        if kind == "odd" and seed == 17:
            os.kill(os.getpid(), signal.SIGKILL)  # a fault in memory would go to pytest's handler first
        if kind == "odd" and seed == 130:
            time.sleep(60.0)
        if kind == "odd" and seed == 150:
            report.fault(seed, "what\nit was")
        else:
            report.outcome("refused" if seed % 3 else "read")
        if report.late():
            return


def test_every_seed_is_drawn_and_faults_do_not_end_it(tmp_path: Path, monkeypatch, capsys):
    """Set-up: of 200 seeds one ends its process, one hangs, one fails. Expected: all are counted."""
    monkeypatch.setattr(draws_in_processes, "HANGS", 0.5)
    faults = share(_draw, ("even", "odd"), range(10, 210), 2, 60.0, tmp_path)
    assert faults["even"] == []
    assert sorted(faults["odd"]) == ["seed 130: hangs", "seed 150: what it was", "seed 17: ended with status 9"]
    said = capsys.readouterr().out
    assert "odd, seed 150: what it was" in said
    rows = {line.split()[0]: line.split()[1:6] for line in said.splitlines()}
    assert rows["even"] == ["200", "134", "66", "0", "0"]  # drawn, refused, read, ended, faults
    assert rows["odd"] == ["200", "132", "65", "0", "3"]
    assert not list(tmp_path.iterdir())


def test_draws_end_when_the_time_is_over(tmp_path: Path, monkeypatch):
    """Set-up: draws that take 0.05 s, and one that takes for ever. Expected: no more after 0.3 s, and no fault."""
    monkeypatch.setattr(draws_in_processes, "GRACE", 0.2)

    def draw(kind: str, seeds: range, folder: Path, report: Report) -> None:
        for _ in seeds:
            time.sleep(0.05 if kind == "slow" else 60.0)
            report.outcome("read")
            if report.late():
                return

    begun = time.monotonic()
    assert share(draw, ("slow", "for ever"), range(100), 2, 0.3, tmp_path) == {"slow": [], "for ever": []}
    assert time.monotonic() - begun < 30.0


def test_a_forked_reader_answers_and_its_end_is_told(tmp_path: Path, monkeypatch):
    """Expected of readers that are forked from here: answers and errors as of a new process, and its end by signal."""
    path = tmp_path / "a.nc"
    path.write_bytes(b"no file of HDF5")
    monkeypatch.setattr(fragile, "_Child", forked_readers._Forked)
    for child in (idle := fragile._idle()):
        child.end()
    idle.clear()
    assert fragile.in_child(path, "math:hypot", 3.0, 4.0) == 5.0
    assert isinstance(idle[0], forked_readers._Forked)
    with pytest.raises(ValueError, match=r"math domain|nonnegative"):
        fragile.in_child(path, "math:sqrt", -1.0)
    with pytest.raises(fragile.LibraryEndedError, match="ended with signal 6"):
        fragile.in_child(path, "os:abort")
    assert idle == []
