"""Tables of the echo store, and echoes as rows of them; docs/hardware.md describes every column."""

import json
import re
import sqlite3
from collections.abc import Mapping
from dataclasses import dataclass
from operator import index
from typing import Any, NamedTuple

import numpy as np

from aerokernels.hardware.frames import EchoFrame
from aerokernels.hardware.preamble import ScopeCurve

APPLICATION_ID = 0x41454348  # marks the SQLite file as an echo store ("AECH")
SCHEMA_VERSION = 3  # stored in `PRAGMA user_version`

# An echo is identified by its board's number, clock and check sum. The number alone is not unique: it wraps, and starts
# again with the board. Number and clock are not either: a board whose clock starts at 0 repeats both. An oscilloscope's
# curves have no time stamp (NULL, which equals nothing): the reader of the port recognises repeated ones.
_SCHEMA = """
CREATE TABLE recordings (
    id INTEGER PRIMARY KEY,
    started_ns INTEGER NOT NULL,
    port TEXT NOT NULL,
    protocol TEXT NOT NULL,
    label TEXT NOT NULL,
    committed_ns INTEGER,
    duplicate_count INTEGER NOT NULL DEFAULT 0
);
CREATE TABLE echoes (
    id INTEGER PRIMARY KEY,
    recording INTEGER NOT NULL REFERENCES recordings(id),
    session INTEGER NOT NULL,
    sequence INTEGER NOT NULL,
    device_time_us INTEGER,
    host_time_ns INTEGER NOT NULL,
    label TEXT NOT NULL,
    flags INTEGER NOT NULL,
    sample_period_ps NUMERIC NOT NULL,
    first_sample_s REAL NOT NULL,
    scale REAL NOT NULL,
    offset REAL NOT NULL,
    sample_count INTEGER NOT NULL,
    samples BLOB NOT NULL,
    crc32 INTEGER NOT NULL,
    preamble TEXT,
    raw BLOB NOT NULL,
    UNIQUE (sequence, device_time_us, crc32)
);
CREATE INDEX echoes_by_label ON echoes (label);
CREATE TABLE damaged (
    id INTEGER PRIMARY KEY,
    recording INTEGER NOT NULL REFERENCES recordings(id),
    host_time_ns INTEGER NOT NULL,
    reason TEXT NOT NULL,
    byte_count INTEGER NOT NULL,
    raw BLOB NOT NULL
);
CREATE VIEW gaps AS
    SELECT session, previous AS after_sequence, sequence AS before_sequence,
        ((sequence - previous) & 4294967295) - 1 AS missing_count
    FROM (
        SELECT echoes.id AS id, session, sequence, LAG(sequence) OVER (
            PARTITION BY port, protocol, session ORDER BY device_time_us < 0, device_time_us, echoes.id
        ) AS previous
        FROM echoes JOIN recordings ON recordings.id = echoes.recording
    )
    WHERE previous IS NOT NULL AND ((sequence - previous) & 4294967295) BETWEEN 2 AND 2147483647
    ORDER BY id;
"""
WRITE_ECHO = (
    "INSERT INTO echoes (recording, session, sequence, device_time_us, host_time_ns, label, flags, "
    "sample_period_ps, first_sample_s, scale, offset, sample_count, samples, crc32, preamble, raw) "
    "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?) "
    "ON CONFLICT (sequence, device_time_us, crc32) DO NOTHING"
)
READ_ECHOES = (
    "SELECT session, host_time_ns, label, sequence, device_time_us, sample_period_ps, first_sample_s, scale, offset, "
    "samples, flags, preamble, raw FROM echoes"
)


def create(connection: sqlite3.Connection) -> None:
    """Create the tables of an empty file; the caller holds the transaction."""
    for statement in _SCHEMA.split(";\n"):
        connection.execute(statement)
    connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    connection.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")


@dataclass(frozen=True, eq=False)
class StoredEcho:
    """One echo read back.

    Attributes:
        session: run of the board at its port, counted from 1; a new session begins where number or clock went back.
        host_time_ns: host clock when the echo was complete [ns since 1970].
        label: the operator's label, such as {"mach": "3"}.
        frame: the frame or the curve; `.time` [s] and `.voltage` [V] are its waveform, `.sequence` its number.
    """

    session: int
    host_time_ns: int
    label: dict[str, str]
    frame: EchoFrame | ScopeCurve


class Gap(NamedTuple):
    """Consecutive numbers of echoes that are missing in the store, after and before two that are there."""

    session: int
    after_sequence: int
    before_sequence: int
    missing_count: int


def row_of(
    echo: EchoFrame | ScopeCurve, recording: int, session: int, sequence: int, host_time_ns: int, label: str
) -> tuple:
    """Return the values for `WRITE_ECHO`."""
    device_time = echo.device_time_us
    return (
        recording, session, sequence, None if device_time is None else signed(device_time), host_time_ns, label,
        echo.flags, echo.sample_period_ps, echo.first_sample_time, echo.scale, echo.offset, echo.samples.size,
        echo.samples.astype("<i2", copy=False).tobytes(), echo.crc, getattr(echo, "preamble", None), echo.raw,
    )  # fmt: skip


def stored_echo(session: Any, host_time: Any, label: Any, *columns: Any) -> StoredEcho:
    """Make an echo from the columns that `READ_ECHOES` selects."""
    sequence, device_time, period, first_sample, scale, offset, samples, flags, preamble, raw = columns
    counts = np.frombuffer(samples, "<i2").astype(np.int16, copy=False)
    if device_time is None:
        frame: EchoFrame | ScopeCurve = ScopeCurve(
            sequence, period, scale, offset, counts, first_sample, preamble or "", bytes(raw)
        )
    else:
        clock = index(device_time) % 2**64
        frame = EchoFrame(sequence, clock, int(period), scale, offset, counts, flags, bytes(raw))
    return StoredEcho(index(session), index(host_time), label_of(label), frame)


def encode_label(label: Mapping[str, str]) -> str:
    """Return a label as it is stored: JSON text with sorted keys, so that equal labels are equal texts."""
    meant = 'a label is texts by their keys, such as {"mach": "3"}'
    if not isinstance(label, Mapping):
        raise TypeError(f"{meant}, got {label!r}")
    for text in (*label, *label.values()):
        if not isinstance(text, str) or re.search(r"[\ud800-\udfff]", text):
            raise TypeError(f"{meant}; {text!r} in {dict(label)!r} is none")
    return json.dumps(dict(label), sort_keys=True, ensure_ascii=False)


def label_of(text: str) -> dict[str, str]:
    """Parse a label as stored: a JSON object of texts; anything else is a ValueError or TypeError."""
    label = json.loads(text)
    if not isinstance(label, dict) or not all(isinstance(value, str) for value in label.values()):
        raise ValueError(f"a label is texts by their keys, got {text[:60]!r}")
    return label


def signed(value: int) -> int:
    """Return an unsigned 64-bit number as SQLite stores it: the same bits read as a signed number."""
    return value - 2**64 if value >= 2**63 else value


class Followed(NamedTuple):
    """An echo as it was followed: its session, number, clock [us] and check sum."""

    session: int
    sequence: int
    device_time: int | None
    crc: int


class Sessions:
    """Follows the numbers of a board in one recording: its sessions, and how many numbers are missing.

    A board counts up, wraps at 2**32, and its clock does not go back; a number or a clock that goes back is that of a
    board that was started again, which begins a new session.

    Attributes:
        last: the latest echo of the port, None before the first.
        missing_count: numbers missing between the echoes of this recording.
    """

    def __init__(self, last: Followed | None = None) -> None:
        """Go on from the last echo of an earlier recording; what is missing after it does not count."""
        self.last = last
        self.missing_count = 0
        self._has_echo = False  # whether this recording has an echo already

    def follow(self, sequence: int, device_time: int | None, crc: int, is_known: bool = False) -> int:
        """Return the session of an echo, and count the numbers that are missing before it.

        One that the store has already (`is_known`) and that goes back was sent again, by a board that was not started
        again.
        """
        last, session = self.last, 1
        if last is not None:
            ahead = (sequence - last.sequence) % 2**32
            is_back = not 0 < ahead < 2**31
            if device_time is not None and last.device_time is not None:
                is_back = is_back or device_time < last.device_time
            if is_back and is_known:
                return last.session
            session = last.session + is_back
            if not is_back and self._has_echo:
                self.missing_count += ahead - 1
        self._has_echo, self.last = True, Followed(session, sequence, device_time, crc)
        return session
