"""The file of an echo store: how SQLite opens it, its errors in words, and a copy of one that lost its name."""

import os
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

from aerokernels.process.foreign_files import FileFault

# Remedy for a damaged store.
KEEP_IT = "keep the file, recover its content with `sqlite3 FILE .recover`, and record into a new file"


class StoreError(RuntimeError):
    """The store cannot be read or written; the message is one line with the reason and the remedy."""

    def __init__(self, message: str):
        """Put the message on one line: SQLite quotes the schema of a damaged file with its line breaks."""
        super().__init__(" ".join(message.split()))


class LockedStoreError(StoreError):
    """Another program keeps the file locked; a later try may succeed."""


class DamagedStoreError(StoreError, FileFault):
    """The file's content is damaged; the message names the file."""


def open_file(path: Path, *, read_only: bool, wait: float) -> sqlite3.Connection:
    """Open or create a store's file, in autocommit mode.

    A finished store in a folder that may not be written (an archive) is opened without the log that SQLite otherwise
    creates beside it: nobody can be writing there.

    Args:
        path: the file.
        read_only: open for reading only; otherwise the file is created if it does not exist.
        wait: longest time to wait for another program that has locked the file [s].

    Raises:
        FileFault: there is no such file or folder.
        sqlite3.Error: SQLite cannot open it.
    """
    if not path.parent.is_dir():
        raise FileFault(f"store {path}: folder {path.parent} does not exist; make it first")
    if path.exists() and not path.is_file():
        raise FileFault(f"store {path}: a folder or a device, not a file; give the file that `record` wrote")
    if read_only and not path.exists():
        raise FileFault(f"store {path}: no such file; record one with `aerokernels record --store`")
    address = f"{path.absolute().as_uri()}?mode={'ro' if read_only else 'rwc'}"
    file = path.resolve()
    log = file.with_name(f"{file.name}-wal")
    if read_only and not os.access(file.parent, os.W_OK) and not (log.exists() and log.stat().st_size):
        address += "&immutable=1"
    return sqlite3.connect(address, uri=True, timeout=wait, isolation_level=None)


@contextmanager
def described_errors(path: Path) -> Iterator[None]:
    """Turn SQLite's errors into errors that name the file and the remedy, by SQLite's own codes.

    Raises:
        StoreError: the file could not be read or written; `DamagedStoreError` where its content is damaged,
            `LockedStoreError` where another program keeps it locked.
        FileFault: the store was closed, is no SQLite file, or may not be opened or written.
    """
    try:
        yield
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF  # the primary code; 0 for an error of the module itself
        if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
            raise LockedStoreError(
                f"store {path}: another program keeps it locked; what was committed is safe: close the file there, or "
                "wait until that program has finished, then record again into the same store"
            ) from error
        if code in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR):
            raise StoreError(
                f"store {path}: {error}; what was committed is safe: make room, then record again into the same store"
            ) from error
        if code == sqlite3.SQLITE_CORRUPT:
            raise DamagedStoreError(f"store {path}: {error}; {KEEP_IT}") from error
        remedies = {
            sqlite3.SQLITE_NOTADB: "give an echo store or a new file name",
            sqlite3.SQLITE_CANTOPEN: "give a file in a folder that may be written, where SQLite keeps the store's log",
            sqlite3.SQLITE_READONLY: "allow to write it and its folder, or give another file name",
            sqlite3.SQLITE_ERROR: "give the file that `record` wrote",
        }
        if code in remedies:
            raise FileFault(f"store {path}: {' '.join(str(error).split())}; {remedies[code]}") from error
        if isinstance(error, sqlite3.ProgrammingError) and not code:
            raise FileFault(f"store {path}: it is closed; open it again") from None
        raise  # a fault of this program, not of the file


@contextmanager
def transaction(connection: sqlite3.Connection, begin: str, path: Path) -> Iterator[None]:
    """Commit all statements of the block or, after an error, none; raises the errors of `described_errors`.

    Args:
        connection: in autocommit mode.
        begin: "BEGIN IMMEDIATE" to write, "BEGIN" to read.
        path: the file, for the message.
    """
    with described_errors(path):
        connection.execute(begin)
        try:
            yield
            connection.execute("COMMIT")
        finally:
            if connection.in_transaction:
                connection.execute("ROLLBACK")


def file_identity(path: Path) -> tuple[int, int] | None:
    """Return what tells this file from another one of its name; None if there is no such file."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino


def save_copy(connection: sqlite3.Connection, path: Path) -> str:
    """Write the content of an open store whose file lost the name `path` to a new file; return a sentence about it.

    The copy is beside the old name or, if that is impossible, in the folder for temporary files. A file that was moved
    is completed, too: its log, which keeps the old name, is merged into it.
    """
    lost = "the file was moved, replaced or deleted while echoes were written to it"
    fault: object = "no folder to copy them to"
    with suppress(sqlite3.Error):
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    for folder in filter(Path.is_dir, (path.parent, Path(tempfile.gettempdir()))):
        # Never the old name itself: the open store's log still has it, and SQLite would take it for the new file's.
        copy = free_name(folder, path, "saved")
        try:
            with closing(sqlite3.connect(copy)) as target:
                connection.backup(target)
        except sqlite3.Error as error:  # no room there, or no permission
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
