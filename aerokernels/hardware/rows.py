"""Echoes as rows of the store, and back."""

import numpy as np

from aerokernels.hardware.frames import EchoFrame
from aerokernels.hardware.preamble import ScopeCurve

WRITE_ECHO = (
    "INSERT OR IGNORE INTO echoes (recording, session, sequence, device_time_us, host_time_ns, label, flags, "
    "sample_period_ps, first_sample_s, scale, offset, sample_count, samples, crc32, preamble, raw) "
    "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"
)
READ_ECHOES = (
    "SELECT session, host_time_ns, label, sequence, device_time_us, sample_period_ps, first_sample_s, scale, offset, "
    "samples, flags, crc32, preamble, raw FROM echoes"
)


def row_of(
    echo: EchoFrame | ScopeCurve, recording: int, session: int, sequence: int, host_time_ns: int, label: str
) -> tuple:
    """What `WRITE_ECHO` takes."""
    device_time = echo.device_time_us
    return (
        recording, session, sequence, None if device_time is None else signed(device_time), host_time_ns, label,
        echo.flags, echo.sample_period_ps, echo.first_sample_time, echo.scale, echo.offset, echo.samples.size,
        echo.samples.astype("<i2", copy=False).tobytes(), echo.crc, getattr(echo, "preamble", None), echo.raw,
    )  # fmt: skip


def echo_of(
    sequence: int,
    device_time: int | None,
    period: float,
    first_sample: float,
    scale: float,
    offset: float,
    samples: bytes,
    flags: int,
    crc: int,
    preamble: str | None,
    raw: bytes,
) -> EchoFrame | ScopeCurve:
    """The echo behind the columns that `READ_ECHOES` selects, from `sequence` on."""
    counts = np.frombuffer(samples, "<i2").astype(np.int16, copy=False)
    if device_time is None:
        return ScopeCurve(sequence, period, scale, offset, counts, first_sample, preamble or "", raw)
    return EchoFrame(sequence, device_time % 2**64, int(period), scale, offset, counts, flags, raw)


def signed(value: int) -> int:
    """An unsigned 64-bit number as SQLite keeps it: the same bits read as signed."""
    return value - 2**64 if value >= 2**63 else value
