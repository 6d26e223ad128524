"""The echo store: one SQLite file (WAL, synchronous FULL) that survives a kill and is readable while it grows.

Once `commit` has returned, the echoes added before it are on the disk; a kill loses only echoes added since.
"""

import json
import sqlite3
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from pathlib import Path

from aerokernels.hardware import rows
from aerokernels.hardware.frames import DamagedPiece, EchoFrame, as_whole
from aerokernels.hardware.preamble import ScopeCurve
from aerokernels.hardware.rows import Followed, Gap, Sessions, StoredEcho, encode_label
from aerokernels.hardware.store_file import (
    KEEP_IT,
    DamagedStoreError,
    StoreError,
    described_errors,
    file_identity,
    free_name,
    open_file,
    save_copy,
    transaction,
)
from aerokernels.inputs.checks import check_path
from aerokernels.process.foreign_files import FileFault

_BUSY_TIME = 30.0  # [s] wait for another recorder that is committing to the same store


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
            self._connection = open_file(self.path, read_only=read_only, wait=_BUSY_TIME)
            try:
                self._prepare(read_only)
            except BaseException:
                self._connection.close()
                if is_new and self.path.is_file() and not self.path.stat().st_size:
                    self.path.unlink()
                raise
        self._read_only = read_only
        self._identity = file_identity(self.path)
        self._recording, self._label, self._origin = 0, "{}", ("", "")
        self._sessions = Sessions()
        self._echoes: list[tuple] = []
        self._keys: set[tuple[int, int, int]] = set()
        self._damaged: list[tuple] = []
        self.duplicate_count = 0  # frames that the store already had, since `begin_recording`
        self.pending_bytes = 0  # in the open batch

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
        """Set the origin and the label of the echoes that follow.

        Numbering continues from the last echo of the same port and protocol: echoes that the board sent while nobody
        recorded are a gap, unless the board was restarted meanwhile.

        Args:
            port: name of the port.
            protocol: name of the protocol.
            label: texts by their keys.

        Raises:
            TypeError: a label that is not texts by their keys, or a name that is no text.
            ValueError: the store was opened for reading only, or is closed.
            StoreError: the store cannot be written.
        """
        for name, given in (("port", port), ("protocol", protocol)):
            if not isinstance(given, str):
                raise TypeError(f"{name} must be a text, got {given!r}")
        if self._read_only:
            raise ValueError(f"store {self.path}: opened for reading only; open it without read_only=True to record")
        self._label, self._origin = encode_label(label), (port, protocol)
        self.duplicate_count = 0
        with self._transaction():
            self._sessions = Sessions(self._last_echo(port, protocol))
            row = (time.time_ns(), port, protocol, self._label)
            self._connection.execute(
                "INSERT INTO recordings (started_ns, port, protocol, label) VALUES (?, ?, ?, ?)", row
            )
            self._recording = self._connection.execute("SELECT last_insert_rowid()").fetchone()[0]

    def add(self, echo: EchoFrame | ScopeCurve, host_time_ns: int) -> bool:
        """Add an echo to the open batch; return False if the store already has it (a frame sent twice).

        Raises:
            ValueError: `begin_recording` was not called before.
            TypeError: something other than an echo, or a host time [ns since 1970] that is no whole number.
        """
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
        self.pending_bytes += 2 * echo.samples.size + len(echo.raw)
        self._echoes.append(rows.row_of(echo, self._recording, session, sequence, host_time_ns, self._label))
        return True

    def add_damaged(self, piece: DamagedPiece, host_time_ns: int) -> None:
        """Add a damaged piece to the open batch; raises the errors of `add`."""
        self._check_recording()
        if not isinstance(piece, DamagedPiece):
            raise TypeError(f"a damaged piece is a DamagedPiece, got {piece!r}")
        host_time_ns = as_whole(host_time_ns, "host_time_ns")
        self.pending_bytes += len(piece.raw)
        self._damaged.append((self._recording, host_time_ns, piece.reason, len(piece.raw), piece.raw))

    def commit(self, wait: float = _BUSY_TIME) -> None:
        """Write the open batch to the disk: when this returns, the batch survives a kill.

        Args:
            wait: longest time to wait for another program that has locked the file [s].

        Raises:
            LockedStoreError: the file is still locked after that time; the batch stays open, for a later commit.
            StoreError: the disk is full or fails, and batches committed before are safe; or the file was moved or
                deleted, and a copy with this batch was written, which the message names.
        """
        if self._echoes or self._damaged:
            self._connection.execute(f"PRAGMA busy_timeout = {round(1e3 * wait)}")
            try:
                self._write_batch()
            finally:
                self._connection.execute(f"PRAGMA busy_timeout = {round(1e3 * _BUSY_TIME)}")
        if file_identity(self.path) != self._identity:
            raise StoreError(f"store {self.path}: {save_copy(self._connection, self.path)}")

    def _write_batch(self) -> None:
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
        self.pending_bytes = 0

    def save_batch(self) -> Path | None:
        """Write the open batch to a new store in the folder for temporary files, if it cannot be written to this one.

        Returns:
            The new file; None if there is nothing to write, or it cannot be written there either.
        """
        if not (self._echoes or self._damaged):
            return None
        path = free_name(Path(tempfile.gettempdir()), self.path, "rest")
        try:
            with EchoStore(path) as other:
                other.begin_recording(*self._origin, json.loads(self._label))
                other._echoes = [(other._recording, *row[1:]) for row in self._echoes]
                other._damaged = [(other._recording, *row[1:]) for row in self._damaged]
                other.commit()
        except (StoreError, ValueError):  # no room there either
            for part in path.parent.glob(f"{path.name}*"):
                part.unlink(missing_ok=True)
            return None
        return path

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
                    f"store {self.path}: a row is not that of an echo ({reason}); {KEEP_IT}"
                ) from None

    def gaps(self) -> list[Gap]:
        """Return the numbers that the store lacks, whoever recorded them, in the order they were noticed."""
        return [Gap(*row) for row in self._rows("SELECT * FROM gaps")]

    def snapshot(self) -> AbstractContextManager[None]:
        """Return a context in which all reads show the store at one moment, even while a recorder writes."""
        return transaction(self._connection, "BEGIN", self.path)

    def _check_recording(self) -> None:
        if not self._recording:
            raise ValueError(f"store {self.path}: call begin_recording(port, protocol, label) before echoes are added")

    def _transaction(self) -> AbstractContextManager[None]:
        return transaction(self._connection, "BEGIN IMMEDIATE", self.path)

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
        found = self._rows(
            "SELECT session, sequence, device_time_us, crc32 FROM echoes WHERE recording IN "
            "(SELECT id FROM recordings WHERE port = ? AND protocol = ?) ORDER BY id DESC LIMIT 1",
            (port, protocol),
        )
        row = next(found, None)
        return None if row is None else Followed(row[0], row[1], None if row[2] is None else row[2] % 2**64, row[3])
