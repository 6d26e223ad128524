"""What goes wrong with the file of an echo store, described in words, and its transactions."""

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

KEEP_IT = "keep it, get out what can be had with `sqlite3 FILE .recover`, and record into a new file"
"""What to do with a damaged store."""


class StoreError(RuntimeError):
    """The store cannot be written; the message says why, and what to do, in one line."""

    def __init__(self, message: str):
        """Keep the message on one line: SQLite quotes the schema of a damaged file, line breaks and all."""
        super().__init__(" ".join(message.split()))


class DamagedStoreError(StoreError, ValueError):
    """The file holds what SQLite cannot read; the message names it."""


@contextmanager
def described_errors(path: Path) -> Iterator[None]:
    """Name the file, and say what to do, where SQLite gives up on it.

    Raises:
        StoreError: the file could not be read or written; `DamagedStoreError` where its content is damaged.
    """
    try:
        yield
    except sqlite3.OperationalError as error:
        raise StoreError(
            f"store {path}: {error}; what was committed is safe: "
            "make room or unlock the file, then record again into the same store"
        ) from error
    except sqlite3.DatabaseError as error:
        if type(error) is not sqlite3.DatabaseError:  # a fault of the program, not of the file
            raise
        raise DamagedStoreError(f"store {path}: {error}; {KEEP_IT}") from error


class Transaction:
    """All or nothing; what goes wrong with the file becomes one message for people.

    Args:
        connection: in autocommit mode.
        begin: "BEGIN IMMEDIATE" to write, "BEGIN" to read.
        path: the file, for the message.

    Raises:
        StoreError: as `described_errors`.
    """

    def __init__(self, connection: sqlite3.Connection, begin: str, path: Path) -> None:
        """Remember; `with` begins."""
        self._connection, self._begin, self._path = connection, begin, path

    def __enter__(self) -> None:
        """Begin."""
        with described_errors(self._path):
            self._connection.execute(self._begin)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: object) -> None:
        """Commit, or go back where something went wrong."""
        try:
            if error is None:
                with described_errors(self._path):
                    self._connection.execute("COMMIT")
        finally:
            if self._connection.in_transaction:
                self._connection.execute("ROLLBACK")
        if isinstance(error, sqlite3.DatabaseError):
            with described_errors(self._path):
                raise error
