"""A store's file that is moved, replaced or deleted while it is written, locked by others, or in a closed folder."""

import sqlite3
import sys
from pathlib import Path

import numpy as np
import pytest

from aerokernels.hardware.frames import EchoFrame
from aerokernels.hardware.store import EchoStore, StoreError


def add(store: EchoStore, *numbers: int) -> None:
    for number in numbers:
        assert store.add(EchoFrame(number, 1000 * number, 250, 1e-3, 0.0, np.arange(20) + number), number)


@pytest.mark.parametrize("read_only", [False, True])
def test_a_file_that_another_program_locks_is_said_to_be_that(tmp_path: Path, monkeypatch, read_only: bool):
    """Before: "database is locked; give an echo store or a new file name", with the status of bad input."""
    path = tmp_path / "e.sqlite"
    with EchoStore(path) as store:
        store.begin_recording("p", "frames", {})
    monkeypatch.setattr("aerokernels.hardware.store._BUSY_TIME", 0.1)
    other = sqlite3.connect(path, isolation_level=None)
    try:
        other.execute("PRAGMA journal_mode = DELETE")  # in WAL mode readers are never locked out
        other.execute("BEGIN EXCLUSIVE")
        with pytest.raises(StoreError, match=r"e\.sqlite: another program keeps it locked"):
            EchoStore(path, read_only=read_only)
    finally:
        other.close()


@pytest.mark.skipif(sys.platform == "win32", reason="an open file keeps its name there")
@pytest.mark.parametrize("how", ["moved", "deleted", "replaced"])
def test_a_file_that_loses_its_name_is_told(tmp_path: Path, how: str):
    """Before, both commits succeeded, and nobody could find their echoes afterwards."""
    path = tmp_path / "e.sqlite"
    with EchoStore(path) as store:
        store.begin_recording("p", "frames", {"mach": "3"})
        add(store, 0, 1)
        store.commit()
        if how == "moved":
            path.rename(tmp_path / "moved.sqlite")
        else:
            for file in tmp_path.glob("e.sqlite*"):
                file.unlink()
        if how == "replaced":
            path.write_text("another file")
        add(store, 2)
        with pytest.raises(StoreError, match=r"e\.sqlite: the file was moved, replaced or deleted"):
            store.commit()
    assert how != "replaced" or path.read_text() == "another file"
