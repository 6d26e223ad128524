"""The echo store: one SQLite file (WAL, synchronous FULL) that survives a kill and is readable while it grows.

Once `commit` has returned, the echoes added before it are on the disk; a kill loses only echoes added since.
"""

import os
import sqlite3
import time
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from aerokernels.hardware import rows
from aerokernels.hardware.frames import DamagedPiece, EchoFrame, as_whole
from aerokernels.hardware.preamble import ScopeCurve
from aerokernels.hardware.rows import Followed, Gap, Sessions, StoredEcho, encode_label
from aerokernels.inputs.checks import check_path
from aerokernels.process.foreign_files import FileFault

_BUSY_TIME = 30.0  # [s] wait for another program that is committing to the same store
_KEEP_IT = "keep the file, recover its content with `sqlite3 FILE .recover`, and record into a new file"


class StoreError(RuntimeError):
    """The store cannot be read or written; the message is one line with the reason and the remedy."""

    def __init__(self, message: str):
        """Put the message on one line: SQLite quotes the schema of a damaged file with its line breaks."""
        super().__init__(" ".join(message.split()))


class DamagedStoreError(StoreError, FileFault):
    """The file's content is damaged; the message names the file."""


@contextmanager
def described_errors(path: Path) -> Iterator[None]:
    """Turn SQLite's errors into a StoreError, or a FileFault where another file must be given; each names the file."""
    try:
        yield
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF  # the primary code; 0 for an error of the module itself
        if code == sqlite3.SQLITE_CORRUPT:
            raise DamagedStoreError(f"store {path}: {error}; {_KEEP_IT}") from error
        if code in (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_ERROR):
            text = " ".join(str(error).split())
            raise FileFault(f"store {path}: {text}; give an echo store in a folder that may be written") from error
        if isinstance(error, sqlite3.ProgrammingError) and not code:
            raise FileFault(f"store {path}: it is closed; open it again") from None
        locked = "another program keeps it locked; " if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED) else ""
        raise StoreError(
            f"store {path}: {locked}{error}; what was committed is safe: make room, or wait for the other program, "
            "then record again into the same store"
        ) from error


@contextmanager
def _transaction(connection: sqlite3.Connection, begin: str, path: Path) -> Iterator[None]:
    """Commit all statements of the block after `begin`, or, after an error, none."""
    with described_errors(path):
        connection.execute(begin)
        try:
            yield
            connection.execute("COMMIT")
        finally:
            if connection.in_transaction:
                connection.execute("ROLLBACK")


def _open_file(path: Path, read_only: bool) -> sqlite3.Connection:
    """Open or create a store's file, in autocommit mode.

    A finished store in a folder that may not be written (an archive) is opened without the log that SQLite otherwise
    creates beside it: nobody can be writing there.
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
    return sqlite3.connect(address, uri=True, timeout=_BUSY_TIME, isolation_level=None)


class EchoStore:
    """Writes and reads an echo store.

    Args:
        path: the file; created if it does not exist and `read_only` is false.
        read_only: open for reading only, which is allowed while a recorder writes.

    Raises:
        ValueError: the file or its folder does not exist, is not an echo store, or has an unknown schema.
        StoreError: the disk is full or fails, or another program keeps the file locked.
    """

    def __init__(self, path: str | Path, *, read_only: bool = False) -> None:
        """Open or create the file."""
        self.path = check_path(path, "path")
        is_new = not self.path.exists()
        with described_errors(self.path):
            self._connection = _open_file(self.path, read_only)
            try:
                self._prepare(read_only)
            except BaseException:
                self._connection.close()
                if is_new and self.path.is_file() and not self.path.stat().st_size:
                    self.path.unlink()
                raise
        self._read_only = read_only
        self._inode = self.path.stat().st_ino
        self._recording, self._label = 0, "{}"
        self._sessions = Sessions()
        self._echoes: list[tuple] = []
        self._keys: set[tuple[int, int, int]] = set()
        self._damaged: list[tuple] = []
        self.duplicate_count = 0  # frames that the store already had, since `begin_recording`

    def _prepare(self, read_only: bool) -> None:
        execute = self._connection.execute
        if not read_only:
            # Check and create in one transaction: two recorders may start on a new file at the same time.
            execute("BEGIN IMMEDIATE")
            if not execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
                rows.create(self._connection)
        if execute("PRAGMA application_id").fetchone()[0] != rows.APPLICATION_ID:
            raise FileFault(f"store {self.path}: a SQLite file, but not an echo store; give another file name")
        version = execute("PRAGMA user_version").fetchone()[0]
        if version != rows.SCHEMA_VERSION:
            raise FileFault(
                f"store {self.path}: schema version {version}, this program knows {rows.SCHEMA_VERSION}; use the "
                "version of aerokernels that wrote it"
            )
        if not read_only:
            execute("COMMIT")
            execute("PRAGMA journal_mode = WAL")
            execute("PRAGMA synchronous = FULL")
            execute("PRAGMA wal_autocheckpoint = 4000")  # pages, 16 MB, before they are moved into the file

    def begin_recording(self, port: str, protocol: str, label: Mapping[str, str]) -> None:
        """Set the port, the protocol and the label (texts by their keys) of the echoes that follow.

        Numbering continues from the last echo of the same port and protocol: echoes that the board sent while nobody
        recorded are a gap, unless the board was restarted meanwhile.
        """
        for name, text in (("port", port), ("protocol", protocol)):
            if not isinstance(text, str):
                raise TypeError(f"{name} must be a text, got {text!r}")
        if self._read_only:
            raise ValueError(f"store {self.path}: opened for reading only; open it without read_only=True to record")
        self._label = encode_label(label)
        self.duplicate_count = 0
        with self._transaction():
            self._sessions = Sessions(self._last_echo(port, protocol))
            row = (time.time_ns(), port, protocol, self._label)
            self._connection.execute(
                "INSERT INTO recordings (started_ns, port, protocol, label) VALUES (?, ?, ?, ?)", row
            )
            self._recording = self._connection.execute("SELECT last_insert_rowid()").fetchone()[0]

    def add(self, echo: EchoFrame | ScopeCurve, host_time_ns: int) -> bool:
        """Add an echo to the open batch; return False if the store already has it (a frame sent twice)."""
        self._check_recording()
        if not isinstance(echo, EchoFrame | ScopeCurve):
            raise TypeError(f"a store holds an EchoFrame or a ScopeCurve, got {echo!r}")
        host_time_ns = as_whole(host_time_ns, "host_time_ns")
        sequence, device_time, last = echo.sequence, echo.device_time_us, self._sessions.last
        if sequence is None:  # the instrument does not count, so the store numbers its curves
            sequence = 0 if last is None else (last.sequence + 1) % 2**32
            is_new = True
        elif device_time is None:  # the last acquisition may be read again after a reconnection
            is_new = last is None or (sequence, echo.crc) != (last.sequence, last.crc)
        else:
            key = (sequence, rows.signed(device_time), echo.crc)
            is_new = key not in self._keys and not self._is_stored(key)
            self._keys.add(key)
        if not is_new:
            self.duplicate_count += 1
            if device_time is not None:  # it may have been another recorder that stored it: this one has seen it too
                self._sessions.follow(sequence, device_time, echo.crc, is_known=True)
            return False
        session = self._sessions.follow(sequence, device_time, echo.crc)
        self._echoes.append(rows.row_of(echo, self._recording, session, sequence, host_time_ns, self._label))
        return True

    def add_damaged(self, piece: DamagedPiece, host_time_ns: int) -> None:
        """Add a damaged piece to the open batch."""
        self._check_recording()
        if not isinstance(piece, DamagedPiece):
            raise TypeError(f"a damaged piece is a DamagedPiece, got {piece!r}")
        host_time_ns = as_whole(host_time_ns, "host_time_ns")
        self._damaged.append((self._recording, host_time_ns, piece.reason, len(piece.raw), piece.raw))

    def commit(self) -> None:
        """Write the open batch to the disk: when this returns, the batch survives a kill.

        Raises:
            StoreError: another program keeps the file locked, the disk is full or fails, or the file was moved or
                deleted; batches committed before are safe.
        """
        try:
            is_here = self.path.stat().st_ino == self._inode
        except OSError:
            is_here = False
        if not is_here:
            raise StoreError(f"store {self.path}: the file was moved, replaced or deleted; record into a new file")
        if not (self._echoes or self._damaged):
            return
        with self._transaction():
            many = self._connection.executemany
            added = many(rows.WRITE_ECHO, self._echoes).rowcount if self._echoes else 0
            # Another recorder of the same board may have stored them first, through a port that allows two (a socket).
            self.duplicate_count += len(self._echoes) - added
            many(
                "INSERT INTO damaged (recording, host_time_ns, reason, byte_count, raw) VALUES (?, ?, ?, ?, ?)",
                self._damaged,
            )
            self._connection.execute(
                "UPDATE recordings SET committed_ns = ?, duplicate_count = ? WHERE id = ?",
                (time.time_ns(), self.duplicate_count, self._recording),
            )
        for batch in (self._echoes, self._keys, self._damaged):
            batch.clear()

    def close(self) -> None:
        """Close the file; an uncommitted batch is dropped."""
        self._connection.close()

    def __enter__(self) -> "EchoStore":
        """Use as a context, at whose end the file is closed."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close."""
        self.close()

    @property
    def pending_count(self) -> int:
        """Number of echoes in the open batch."""
        return len(self._echoes)

    @property
    def last_sequence(self) -> int | None:
        """Number of the last echo of this port, committed or not; None before the first."""
        return None if self._sessions.last is None else self._sessions.last.sequence

    @property
    def missing_count(self) -> int:
        """Numbers missing between the echoes that were received since `begin_recording`."""
        return self._sessions.missing_count

    @property
    def echo_count(self) -> int:
        """Number of echoes in the store."""
        return next(self._rows("SELECT count(*) FROM echoes"))[0]

    @property
    def damaged_count(self) -> int:
        """Number of damaged pieces in the store."""
        return next(self._rows("SELECT count(*) FROM damaged"))[0]

    def labels(self) -> list[dict[str, str]]:
        """Return the different labels in the store, in the order of their first echo."""
        return [
            rows.label_of(text) for (text,) in self._rows("SELECT label FROM echoes GROUP BY label ORDER BY min(id)")
        ]

    def echoes(self, label: Mapping[str, str] | None = None) -> Iterator[StoredEcho]:
        """Yield the echoes in the order they were recorded; with `label`, only those with exactly this label."""
        where, values = ("", ()) if label is None else ("WHERE label = ?", (encode_label(label),))
        for columns in self._rows(f"{rows.READ_ECHOES} {where} ORDER BY id", values):
            try:
                yield rows.stored_echo(*columns)
            except (TypeError, ValueError, ArithmeticError) as error:  # written by another program, or damaged
                reason = " ".join(str(error).split())[:200]
                raise DamagedStoreError(
                    f"store {self.path}: a row is not that of an echo ({reason}); {_KEEP_IT}"
                ) from None

    def gaps(self) -> list[Gap]:
        """Return the numbers that the store lacks, whoever recorded them, in the order they were noticed."""
        return [Gap(*row) for row in self._rows("SELECT * FROM gaps")]

    def snapshot(self) -> AbstractContextManager[None]:
        """Return a context in which all reads show the store at one moment, even while a recorder writes."""
        return _transaction(self._connection, "BEGIN", self.path)

    def _check_recording(self) -> None:
        if not self._recording:
            raise ValueError(f"store {self.path}: call begin_recording(port, protocol, label) before echoes are added")

    def _transaction(self) -> AbstractContextManager[None]:
        return _transaction(self._connection, "BEGIN IMMEDIATE", self.path)

    def _rows(self, query: str, values: tuple = ()) -> Iterator[tuple]:
        with described_errors(self.path):
            # Not `yield from` the cursor: an abandoned generator would close it, perhaps after the file is closed.
            yield from iter(self._connection.execute(query, values).fetchone, None)

    def _is_stored(self, key: tuple[int, int, int]) -> bool:
        query = "SELECT 1 FROM echoes WHERE sequence = ? AND device_time_us = ? AND crc32 = ?"
        try:  # called for each frame, so the error handling must cost nothing in the usual case
            return self._connection.execute(query, key).fetchone() is not None
        except sqlite3.DatabaseError:
            with described_errors(self.path):
                raise

    def _last_echo(self, port: str, protocol: str) -> Followed | None:
        last = self._rows(
            "SELECT session, sequence, device_time_us, crc32 FROM echoes WHERE recording IN "
            "(SELECT id FROM recordings WHERE port = ? AND protocol = ?) ORDER BY id DESC LIMIT 1",
            (port, protocol),
        )
        row = next(last, None)
        return None if row is None else Followed(row[0], row[1], None if row[2] is None else row[2] % 2**64, row[3])
