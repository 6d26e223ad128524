"""A transaction of the echo store whose failures are told in words."""

import sqlite3
from pathlib import Path


class StoreError(RuntimeError):
    """The store cannot be written; the message says why, and what to do."""


class Transaction:
    """All or nothing; what goes wrong with the file becomes one message for people.

    Args:
        connection: in autocommit mode.
        begin: "BEGIN IMMEDIATE" to write, "BEGIN" to read.
        path: the file, for the message.

    Raises:
        StoreError: the file could not be read or written.
    """

    def __init__(self, connection: sqlite3.Connection, begin: str, path: Path) -> None:
        """Remember; `with` begins."""
        self._connection, self._begin, self._path = connection, begin, path

    def __enter__(self) -> None:
        """Begin."""
        try:
            self._connection.execute(self._begin)
        except sqlite3.OperationalError as error:
            raise self._error(error) from error

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: object) -> None:
        """Commit, or go back where something went wrong."""
        if error is None:
            try:
                self._connection.execute("COMMIT")
                return
            except sqlite3.OperationalError as failure:
                error = failure
        if self._connection.in_transaction:
            self._connection.execute("ROLLBACK")
        if isinstance(error, sqlite3.OperationalError):
            raise self._error(error) from error

    def _error(self, error: sqlite3.OperationalError) -> StoreError:
        return StoreError(
            f"store {self._path}: {error}; what was committed is safe: "
            "make room or unlock the file, then record again into the same store"
        )
