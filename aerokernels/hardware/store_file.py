"""A store's file: its SQLite address, after checking how it may be opened, and a copy of one that lost its name."""

import contextlib
import os
import sqlite3
import tempfile
from pathlib import Path

from aerokernels.process.foreign_files import FileFault


def store_address(path: Path, *, read_only: bool) -> str:
    """Return the address by which SQLite opens a store.

    A finished store in a read-only folder (an archive) is opened without the log that SQLite otherwise creates beside
    it: nobody can be writing there.

    Args:
        path: the file.
        read_only: open for reading only; otherwise the file is created if it does not exist.

    Raises:
        ValueError: the file or its folder does not exist, is not a file, or may not be written.
    """
    if not path.parent.is_dir():
        raise FileFault(f"store {path}: folder {path.parent} does not exist; make it first")
    address = path.absolute().as_uri()
    if not read_only:
        if path.exists() and not path.is_file():
            raise FileFault(f"store {path}: a folder or a device, not a file; give another file name")
        if path.is_file() and not os.access(path, os.W_OK):
            raise FileFault(f"store {path}: no permission to write it; allow it, or give another file name")
        if not os.access(path.resolve().parent, os.W_OK):
            raise FileFault(
                f"store {path}: no permission to write in its folder, where SQLite keeps the store's log; allow it, or "
                "give a file in another folder"
            )
        return f"{address}?mode=rwc"
    if not path.is_file():
        if path.exists():
            raise FileFault(f"store {path}: a folder or a device, not a file; give the file that `record` wrote")
        raise FileFault(f"store {path}: no such file; record one with `aerokernels record --store`")
    file = path.resolve()  # SQLite creates the log beside the file itself, not beside a link to it
    log, index = (file.with_name(f"{file.name}-{end}") for end in ("wal", "shm"))
    is_closed = not os.access(file.parent, os.W_OK)
    archived = is_closed and not (log.exists() and log.stat().st_size)
    if is_closed and not archived and not index.exists():
        raise FileFault(
            f"store {path}: some of its echoes are in {log.name} beside it, which can only be read in a folder that "
            "may be written; copy both files to one"
        )
    return f"{address}?mode=ro{'&immutable=1' if archived else ''}"


def file_identity(path: Path) -> tuple[int, int] | None:
    """Return what tells this file from another one of its name; None if there is no such file."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino


def save_copy(connection: sqlite3.Connection, path: Path) -> str:
    """Write the content of an open store whose file no longer has its name to a new file; return a sentence about it.

    A file that was moved is completed, too: its log, which keeps the old name, is merged into it.

    Args:
        connection: the open store, outside a transaction.
        path: the name that the file had; the copy is beside it, or in the folder for temporary files.
    """
    lost = "the file was moved, replaced or deleted while echoes were written to it"
    fault: object = "no folder to copy them to"
    with contextlib.suppress(sqlite3.Error):
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    for folder in (path.parent, Path(tempfile.gettempdir())):
        if not (folder.is_dir() and os.access(folder, os.W_OK)):
            continue
        # Never the old name itself: the open store's log still has it, and SQLite would take it for the new file's.
        copy = free_name(folder, path, "saved")
        try:
            with contextlib.closing(sqlite3.connect(copy)) as target:
                connection.backup(target)
        except sqlite3.Error as error:  # no room there
            fault = error
            copy.unlink(missing_ok=True)
        else:
            return f"{lost}; all of its echoes are in {copy}: record again, into that file or a new one"
    return f"{lost}, and its echoes could not be copied ({fault}): if it was moved, give it its old name again"


def free_name(folder: Path, path: Path, what: str) -> Path:
    """Return a name in `folder` that no file has: that of `path` with `what` and, if necessary, a number."""
    found, number = folder / f"{path.stem}-{what}{path.suffix}", 1
    while found.exists():
        number += 1
        found = folder / f"{path.stem}-{what}-{number}{path.suffix}"
    return found
