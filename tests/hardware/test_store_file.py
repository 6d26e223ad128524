"""A store's file that is moved, replaced or deleted while it is written, locked by others, or in a closed folder."""

import shutil
import sqlite3
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest

from aerokernels.hardware.frames import EchoFrame
from aerokernels.hardware.store import EchoStore
from aerokernels.hardware.transaction import StoreError


def add(store: EchoStore, *numbers: int) -> None:
    for number in numbers:
        assert store.add(EchoFrame(number, 1000 * number, 250, 1e-3, 0.0, np.arange(20) + number), number)


def numbers_in(path: Path) -> list[int]:
    with sqlite3.connect(path) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        found = [number for (number,) in connection.execute("SELECT sequence FROM echoes ORDER BY id")]
    connection.close()
    return found


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
        with pytest.raises(StoreError, match=r"e\.sqlite: another program has kept it locked for 0\.1 s; close"):
            EchoStore(path, read_only=read_only)
    finally:
        other.close()


@pytest.mark.skipif(sys.platform == "win32", reason="no permissions of this kind there")
def test_a_folder_that_may_not_be_written(run_code):
    """A finished store is read there; one with a log is not, as SQLite would say "unable to open database file"."""
    place = tempfile.TemporaryDirectory()  # pytest's own folders are closed to other users
    folder = Path(place.name)
    folder.chmod(0o755)
    for name in ("finished", "killed"):
        (folder / name).mkdir()
        with EchoStore(folder / f"{name}.sqlite") as store:
            store.begin_recording("p", "frames", {})
            add(store, 0)
            store.commit()
            if name == "killed":
                shutil.copy(folder / f"{name}.sqlite-wal", folder / name / "e.sqlite-wal")
                shutil.copy(folder / f"{name}.sqlite", folder / name / "e.sqlite")
        if name == "finished":
            shutil.copy(folder / f"{name}.sqlite", folder / name / "e.sqlite")
        (folder / name).chmod(0o555)
    code = (
        "import os, sys\n"
        "from aerokernels.hardware.store import EchoStore\n"
        "if os.getuid() == 0:\n"  # who may do everything
        "    os.setgroups([]); os.setgid(65534); os.setuid(65534)\n"
        "for name in ('finished', 'killed'):\n"
        "    for read_only in (True, False):\n"
        "        try:\n"
        "            with EchoStore(name + '/e.sqlite', read_only=read_only) as store:\n"
        "                print(store.echo_count)\n"
        "        except Exception as error:\n"
        "            print(type(error).__name__, error)\n"
    )
    try:
        done = run_code(code, folder)
    finally:
        for name in ("finished", "killed"):
            (folder / name).chmod(0o755)
        place.cleanup()
    read, written, log, written_too = done.stdout.splitlines()
    assert read == "1"
    assert log.startswith("FileFault store killed/e.sqlite: some of its echoes are in e.sqlite-wal beside it")
    for line in (written, written_too):
        assert "no permission to write" in line


@pytest.mark.skipif(sys.platform == "win32", reason="an open file keeps its name there")
@pytest.mark.parametrize("how", ["moved", "deleted", "replaced"])
def test_a_file_that_loses_its_name_is_saved_under_another(tmp_path: Path, how: str):
    """Before, both commits succeeded, and nobody could find their echoes afterwards."""
    path = tmp_path / "e.sqlite"
    (tmp_path / "e-saved.sqlite").write_text("another file")
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
        with pytest.raises(StoreError, match=r"e\.sqlite: the file was moved.* are in .*e-saved-2\.sqlite: record"):
            store.commit()
    assert numbers_in(tmp_path / "e-saved-2.sqlite") == [0, 1, 2]
    assert (tmp_path / "e-saved.sqlite").read_text() == "another file"
    assert how != "moved" or numbers_in(tmp_path / "moved.sqlite") == [0, 1, 2]
    assert how != "replaced" or path.read_text() == "another file"
    with EchoStore(tmp_path / "e-saved-2.sqlite") as store:  # it is a store like any other
        store.begin_recording("p", "frames", {"mach": "3"})
        add(store, 3)
        store.commit()
        assert store.echo_count == 4 and not store.gaps()


@pytest.mark.skipif(sys.platform == "win32", reason="no limit on the size of files there")
def test_a_copy_for_which_there_is_no_room(tmp_path: Path, run_code):
    """A process that may write no file beyond 20 kB after a store of 60 kB was moved: the remedy holds."""
    code = (
        "import os, resource\n"
        "import numpy as np\n"
        "from aerokernels.hardware.frames import EchoFrame\n"
        "from aerokernels.hardware.store import EchoStore\n"
        "store = EchoStore('e.sqlite')\n"
        "store.begin_recording('p', 'frames', {})\n"
        "for number in range(20):\n"
        "    store.add(EchoFrame(number, number, 250, 1e-3, 0.0, np.arange(1000)), number)\n"
        "store.commit()\n"
        "os.rename('e.sqlite', 'moved.sqlite')\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))\n"
        "store.commit()\n"
    )
    done = run_code(code)
    assert done.returncode == 1 and "could not be copied (disk I/O error)" in done.stderr, done.stderr
    assert "if it was moved, give it its old name again" in done.stderr
    assert not list(tmp_path.glob("*saved*"))
    (tmp_path / "moved.sqlite").rename(tmp_path / "e.sqlite")  # the log still has that name
    assert numbers_in(tmp_path / "e.sqlite") == list(range(20))


@pytest.mark.skipif(sys.platform == "win32", reason="no limit on the size of files there")
def test_a_batch_for_which_there_is_no_room_anywhere(tmp_path: Path, run_code):
    """The batch stays open in the store, and nothing half-written is left among the temporary files."""
    code = (
        "import resource\n"
        "import numpy as np\n"
        "from aerokernels.hardware.frames import EchoFrame\n"
        "from aerokernels.hardware.store import EchoStore\n"
        "store = EchoStore('e.sqlite')\n"
        "store.begin_recording('p', 'frames', {})\n"
        "assert store.save_batch() is None\n"
        "for number in range(20):\n"
        "    store.add(EchoFrame(number, number, 250, 1e-3, 0.0, np.arange(1000)), number)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, resource.RLIM_INFINITY))\n"
        "print(store.save_batch(), store.pending_count)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))\n"
        "store.commit()\n"
    )
    done = run_code(code)
    assert done.returncode == 0 and done.stdout.split() == ["None", "20"], done.stderr
    assert not list(tmp_path.glob("e-rest*")) and numbers_in(tmp_path / "e.sqlite") == list(range(20))


@pytest.mark.skipif(sys.platform == "win32", reason="an open file keeps its name there")
def test_a_folder_that_is_moved_leaves_the_copy_among_temporary_files(tmp_path: Path, monkeypatch):
    """Nothing new was added since the last commit: the next one notices it all the same."""
    (tmp_path / "temporary").mkdir()
    (tmp_path / "day").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    with EchoStore(tmp_path / "day" / "e.sqlite") as store:
        store.begin_recording("p", "frames", {})
        add(store, 0)
        store.commit()
        (tmp_path / "day").rename(tmp_path / "yesterday")
        with pytest.raises(StoreError, match="temporary"):
            store.commit()
    assert numbers_in(tmp_path / "temporary" / "e-saved.sqlite") == [0]
    assert numbers_in(tmp_path / "yesterday" / "e.sqlite") == [0]
