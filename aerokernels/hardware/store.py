"""The echo store: one SQLite file (WAL, synchronous FULL) that survives a kill and is readable while it grows.

What `commit` has returned for is on the disk; what was added since is lost with the process, and nothing else is.
"""

import json
import sqlite3
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aerokernels.hardware.decoder import DamagedPiece
from aerokernels.hardware.frames import EchoFrame
from aerokernels.hardware.schema import APPLICATION_ID, SCHEMA, SCHEMA_VERSION


@dataclass(frozen=True, eq=False)
class StoredEcho:
    """One echo read back.

    Attributes:
        session: run of the board, counted from 1; a new one where its number or its clock went back.
        host_time_ns: host clock when the frame was complete [ns since 1970].
        label: what the operator said about it, such as {"mach": "3"}.
        frame: the frame; `.time` [s] and `.voltage` [V] are its waveform.
    """

    session: int
    host_time_ns: int
    label: dict[str, str]
    frame: EchoFrame


class EchoStore:
    """Writes and reads an echo store.

    Args:
        path: the file; made when it is not there and `read_only` is false.
        read_only: open for reading, which is allowed while a recorder writes.

    Raises:
        ValueError: no such file or folder, not an echo store, or a schema this version does not know.
    """

    def __init__(self, path: str | Path, *, read_only: bool = False) -> None:
        """Open the file, or make it."""
        self.path = Path(path)
        if not self.path.parent.is_dir():
            raise ValueError(f"store {self.path}: folder {self.path.parent} does not exist; make it first")
        if read_only and not self.path.is_file():
            raise ValueError(f"store {self.path}: no such file; record one with `aerokernels record --store`")
        uri = self.path.absolute().as_uri() + ("?mode=ro" if read_only else "?mode=rwc")
        try:
            self._connection = sqlite3.connect(uri, uri=True, timeout=10.0, isolation_level=None)
        except sqlite3.OperationalError as error:
            raise ValueError(f"store {self.path}: {error}; give a file that can be opened") from error
        try:
            self._prepare(read_only)
        except sqlite3.DatabaseError as error:
            self._connection.close()
            raise ValueError(f"store {self.path}: {error}; give an echo store or a new file name") from error
        except ValueError:
            self._connection.close()
            raise
        self._recording = 0
        self._label = "{}"
        self._last = self._last_echo()

    def _prepare(self, read_only: bool) -> None:
        execute = self._connection.execute
        if not read_only:
            # The check and the creation are one transaction: two recorders may start on a new file at once.
            execute("BEGIN IMMEDIATE")
            if not execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
                for statement in SCHEMA.split(";")[:-1]:
                    execute(statement)
                execute(f"PRAGMA application_id = {APPLICATION_ID}")
                execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
            execute("COMMIT")
        if execute("PRAGMA application_id").fetchone()[0] != APPLICATION_ID:
            raise ValueError(f"store {self.path}: a SQLite file, but not an echo store; give another file name")
        version = execute("PRAGMA user_version").fetchone()[0]
        if version != SCHEMA_VERSION:
            raise ValueError(
                f"store {self.path}: schema version {version}, this program knows {SCHEMA_VERSION}; "
                "use the version of aerokernels that wrote it"
            )
        if not read_only:
            execute("PRAGMA journal_mode = WAL")
            execute("PRAGMA synchronous = FULL")

    def begin_recording(self, port: str, protocol: str, label: Mapping[str, str]) -> None:
        """Say where the frames that follow come from and what their label is."""
        self._label = encode_label(label)
        self._begin()
        row = (time.time_ns(), port, protocol, self._label)
        self._connection.execute("INSERT INTO recordings (started_ns, port, protocol, label) VALUES (?, ?, ?, ?)", row)
        self._recording = self._connection.execute("SELECT last_insert_rowid()").fetchone()[0]
        self.commit()

    def add(self, frame: EchoFrame, host_time_ns: int) -> bool:
        """Add a good frame to the open batch; False when the store already has it (a frame sent twice)."""
        self._begin()
        session = self._session_of(frame)
        added = self._connection.execute(
            "INSERT OR IGNORE INTO echoes (recording, session, sequence, device_time_us, host_time_ns, label, flags, "
            "sample_period_ps, scale, offset, sample_count, samples, crc32, raw) "
            "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (
                self._recording, session, frame.sequence, _signed(frame.device_time_us), host_time_ns, self._label,
                frame.flags, frame.sample_period_ps, frame.scale, frame.offset, frame.samples.size,
                frame.samples.astype("<i2").tobytes(), frame.crc, frame.raw,
            ),
        ).rowcount  # fmt: skip
        if added:
            self._last = (session, frame.sequence, frame.device_time_us)
        return bool(added)

    def add_damaged(self, piece: DamagedPiece, host_time_ns: int) -> None:
        """Add a damaged piece to the open batch."""
        self._begin()
        self._connection.execute(
            "INSERT INTO damaged (recording, host_time_ns, reason, byte_count, raw) VALUES (?, ?, ?, ?, ?)",
            (self._recording, host_time_ns, piece.reason, len(piece.raw), piece.raw),
        )

    def commit(self) -> None:
        """Put the open batch on the disk: when this returns, it survives a kill."""
        if self._connection.in_transaction:
            self._connection.execute("COMMIT")

    def close(self) -> None:
        """Close the file; an open batch that was not committed is dropped."""
        self._connection.close()

    def __enter__(self) -> "EchoStore":
        """Use as a context: closed at its end."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close."""
        self.close()

    @property
    def echo_count(self) -> int:
        """Echoes in the store."""
        return self._connection.execute("SELECT count(*) FROM echoes").fetchone()[0]

    @property
    def damaged_count(self) -> int:
        """Damaged pieces in the store."""
        return self._connection.execute("SELECT count(*) FROM damaged").fetchone()[0]

    def labels(self) -> list[dict[str, str]]:
        """The different labels in the store, in the order they were first recorded."""
        rows = self._connection.execute("SELECT label FROM echoes GROUP BY label ORDER BY min(id)")
        return [json.loads(text) for (text,) in rows]

    def echoes(self, label: Mapping[str, str] | None = None) -> Iterator[StoredEcho]:
        """The echoes in the order they were recorded; with `label`, only those with exactly this label."""
        where, values = ("", ()) if label is None else ("WHERE label = ?", (encode_label(label),))
        rows = self._connection.execute(
            "SELECT session, host_time_ns, label, sequence, device_time_us, sample_period_ps, scale, offset, samples, "
            f"flags, raw FROM echoes {where} ORDER BY id",
            values,
        )
        for session, host_time, text, sequence, device_time, period, scale, offset, samples, flags, raw in rows:
            counts = np.frombuffer(samples, "<i2")
            frame = EchoFrame(sequence, device_time % 2**64, period, scale, offset, counts, flags, raw)
            yield StoredEcho(session, host_time, json.loads(text), frame)

    def _begin(self) -> None:
        if not self._connection.in_transaction:
            self._connection.execute("BEGIN IMMEDIATE")

    def _last_echo(self) -> tuple[int, int, int] | None:
        row = self._connection.execute(
            "SELECT session, sequence, device_time_us FROM echoes ORDER BY id DESC LIMIT 1"
        ).fetchone()
        return row and (row[0], row[1], row[2] % 2**64)

    def _session_of(self, frame: EchoFrame) -> int:
        """A board counts up (across 2**32 - 1 too) while its clock does not go back; otherwise it started again."""
        if self._last is None:
            return 1
        session, sequence, device_time = self._last
        ahead = 0 < (frame.sequence - sequence) % 2**32 < 2**31
        return session if ahead and frame.device_time_us >= device_time else session + 1


def encode_label(label: Mapping[str, str]) -> str:
    """A label as it is stored: JSON text with sorted keys, so that equal labels are equal text."""
    return json.dumps(dict(label), sort_keys=True, ensure_ascii=False)


def _signed(value: int) -> int:
    """An unsigned 64-bit number as SQLite keeps it: the same bits read as signed."""
    return value - 2**64 if value >= 2**63 else value
