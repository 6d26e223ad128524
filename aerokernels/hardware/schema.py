"""Schema of the echo store, version 1; docs/hardware.md describes every column for readers of the file."""

APPLICATION_ID = 0x41454348
"""Marks the SQLite file as an echo store ("AECH")."""

SCHEMA_VERSION = 1
"""Kept in `PRAGMA user_version`."""

# An echo is known by what its board stamped on it: number, clock and check sum. The number alone is not enough: it
# wraps and starts again with the board. Nor are number and clock: a board whose clock starts at 0 repeats both.
SCHEMA = """
CREATE TABLE recordings (
    id INTEGER PRIMARY KEY,
    started_ns INTEGER NOT NULL,
    port TEXT NOT NULL,
    protocol TEXT NOT NULL,
    label TEXT NOT NULL
);
CREATE TABLE echoes (
    id INTEGER PRIMARY KEY,
    recording INTEGER NOT NULL REFERENCES recordings(id),
    session INTEGER NOT NULL,
    sequence INTEGER NOT NULL,
    device_time_us INTEGER NOT NULL,
    host_time_ns INTEGER NOT NULL,
    label TEXT NOT NULL,
    flags INTEGER NOT NULL,
    sample_period_ps INTEGER NOT NULL,
    scale REAL NOT NULL,
    offset REAL NOT NULL,
    sample_count INTEGER NOT NULL,
    samples BLOB NOT NULL,
    crc32 INTEGER NOT NULL,
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
FROM (SELECT session, sequence, LAG(sequence) OVER (PARTITION BY session ORDER BY id) AS previous FROM echoes)
WHERE previous IS NOT NULL AND ((sequence - previous) & 4294967295) > 1;
"""
