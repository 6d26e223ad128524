"""Transactions on an echo store, and errors of its file in words."""

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from aerokernels.process.foreign_files import FileFault

_LOCKED = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
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


def opening_error(path: Path, error: sqlite3.DatabaseError, read_only: bool, wait: float) -> Exception:
    """Return the error, with its remedy, of a store that cannot be opened.

    Args:
        path: the file.
        error: SQLite's error.
        read_only: whether it was opened for reading only.
        wait: time for which another program's lock was waited for [s].
    """
    code = _code(error)
    if code in _LOCKED:
        return LockedStoreError(
            f"store {path}: another program has kept it locked for {wait:g} s; close the file there, or wait until "
            "that program has finished"
        )
    if code in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR):
        return StoreError(f"store {path}: {error}; make room first, or give another file name")
    remedy = "give the file that `record` wrote" if read_only else "give an echo store or a new file name"
    if code == sqlite3.SQLITE_CORRUPT:  # the beginning of the file is that of a database, the rest is not
        remedy = KEEP_IT
    return FileFault(f"store {path}: {' '.join(str(error).split())}; {remedy}")  # SQLite quotes lines of the schema


def _code(error: sqlite3.Error) -> int:
    """Return SQLite's primary result code of an error; 0 for an error of the module itself."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF


def _is_closed(connection: sqlite3.Connection) -> bool:
    try:
        _ = connection.total_changes
    except sqlite3.ProgrammingError:
        return True
    return False


@contextmanager
def described_errors(path: Path, connection: sqlite3.Connection) -> Iterator[None]:
    """Turn errors of SQLite into errors that name the file and the remedy.

    Raises:
        StoreError: the file could not be read or written; `DamagedStoreError` where its content is damaged,
            `LockedStoreError` where another program keeps it locked.
        ValueError: the store was closed.
    """
    try:
        yield
    except sqlite3.OperationalError as error:
        if _code(error) in _LOCKED:
            raise LockedStoreError(
                f"store {path}: another program keeps it locked; what was committed is safe: close the file there, or "
                "wait until that program has finished, then record again into the same store"
            ) from error
        raise StoreError(
            f"store {path}: {error}; what was committed is safe: make room, then record again into the same store"
        ) from error
    except sqlite3.ProgrammingError:
        if _is_closed(connection):
            raise FileFault(f"store {path}: it is closed; open it again") from None
        raise
    except sqlite3.DatabaseError as error:
        if type(error) is not sqlite3.DatabaseError:  # its other subclasses are bugs of this program, not of the file
            raise
        raise DamagedStoreError(f"store {path}: {error}; {KEEP_IT}") from error


@contextmanager
def transaction(connection: sqlite3.Connection, begin: str, path: Path) -> Iterator[None]:
    """Commit all statements of the block or, after an error, none; errors of the file become a `StoreError`.

    Args:
        connection: in autocommit mode.
        begin: "BEGIN IMMEDIATE" to write, "BEGIN" to read.
        path: the file, for the message.

    Raises:
        StoreError: as `described_errors`.
    """
    with described_errors(path, connection):
        connection.execute(begin)
        try:
            yield
            connection.execute("COMMIT")
        finally:
            if connection.in_transaction:
                connection.execute("ROLLBACK")
