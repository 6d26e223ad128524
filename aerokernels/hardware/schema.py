"""Schema of the echo store; docs/hardware.md describes every column."""

import contextlib
import re
import sqlite3

APPLICATION_ID = 0x41454348  # marks the SQLite file as an echo store ("AECH")
SCHEMA_VERSION = 2  # stored in `PRAGMA user_version`

# An echo is identified by its board's number, clock and check sum. The number alone is not unique: it wraps, and starts
# again with the board. Number and clock are not either: a board whose clock starts at 0 repeats both. An oscilloscope's
# curves have no time stamp (NULL, which equals nothing): the reader of the port recognises repeated ones.
_ECHOES = """
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
)"""
_ECHOES_BY_LABEL = "CREATE INDEX echoes_by_label ON echoes (label)"
_GAPS = """
CREATE TABLE gaps (
    id INTEGER PRIMARY KEY,
    recording INTEGER NOT NULL REFERENCES recordings(id),
    session INTEGER NOT NULL,
    after_sequence INTEGER NOT NULL,
    before_sequence INTEGER NOT NULL,
    missing_count INTEGER NOT NULL,
    host_time_ns INTEGER NOT NULL
)"""
_RECORDINGS = """
CREATE TABLE recordings (
    id INTEGER PRIMARY KEY,
    started_ns INTEGER NOT NULL,
    port TEXT NOT NULL,
    protocol TEXT NOT NULL,
    label TEXT NOT NULL,
    committed_ns INTEGER,
    duplicate_count INTEGER NOT NULL DEFAULT 0
)"""
_DAMAGED = """
CREATE TABLE damaged (
    id INTEGER PRIMARY KEY,
    recording INTEGER NOT NULL REFERENCES recordings(id),
    host_time_ns INTEGER NOT NULL,
    reason TEXT NOT NULL,
    byte_count INTEGER NOT NULL,
    raw BLOB NOT NULL
)"""

_COPIED = (
    "id, recording, session, sequence, device_time_us, host_time_ns, label, flags, sample_period_ps, "
    "scale, offset, sample_count, samples, crc32, raw"
)
# Statements that turn a store of version n into one of version n + 1.
_UPGRADES = {
    1: (
        "DROP VIEW gaps",
        "DROP INDEX echoes_by_label",
        "ALTER TABLE echoes RENAME TO old_echoes",
        "ALTER TABLE recordings ADD COLUMN committed_ns INTEGER",
        "ALTER TABLE recordings ADD COLUMN duplicate_count INTEGER NOT NULL DEFAULT 0",
        _ECHOES,
        _ECHOES_BY_LABEL,
        f"INSERT INTO echoes ({_COPIED}, first_sample_s) SELECT {_COPIED}, 0.0 FROM old_echoes ORDER BY id",
        "DROP TABLE old_echoes",
        _GAPS,
        "INSERT INTO gaps (recording, session, after_sequence, before_sequence, missing_count, host_time_ns) "
        "SELECT recording, session, previous, sequence, ((sequence - previous) & 4294967295) - 1, host_time_ns "
        "FROM (SELECT *, LAG(sequence) OVER (PARTITION BY session ORDER BY id) AS previous FROM echoes) "
        "WHERE previous IS NOT NULL AND ((sequence - previous) & 4294967295) > 1 ORDER BY id",
    ),
}


def create(connection: sqlite3.Connection) -> None:
    """Create the tables of an empty file; the caller holds the transaction."""
    for statement in (_RECORDINGS, _ECHOES, _ECHOES_BY_LABEL, _DAMAGED, _GAPS):
        connection.execute(statement)
    connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    connection.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")


def foreign_part(connection: sqlite3.Connection) -> str:
    """Return a table, index, view or trigger that a store has and should not have, or the reverse; "" if none.

    A trigger may delete each echo that is stored, a view in place of a table may have no end, an index may refuse rows.
    Texts are compared without their spaces: an older store has others. SQLite's own statistics do not count.
    """
    with contextlib.closing(sqlite3.connect(":memory:")) as new:
        create(new)
        differing = sorted(_parts(new) ^ _parts(connection))
    return " ".join(differing[0][:2]) if differing else ""


def _parts(connection: sqlite3.Connection) -> set[tuple[str, str, str]]:
    found = connection.execute(
        "SELECT type, name, sql FROM sqlite_master WHERE sql IS NOT NULL AND NOT (type = 'table' AND name LIKE "
        "'sqlite_stat_')"
    )
    return {(str(kind), str(name), re.sub(r"\s*([(),])\s*|\s+", r"\1 ", str(text))) for kind, name, text in found}


def upgrade(connection: sqlite3.Connection) -> None:
    """Bring an older store up to date; the caller holds the transaction."""
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    while version in _UPGRADES:
        for statement in _UPGRADES[version]:
            connection.execute(statement)
        version += 1
        connection.execute(f"PRAGMA user_version = {version}")
