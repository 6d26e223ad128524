"""Convert echoes to rows of the store and back."""

import json
from operator import index

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
    """Return the values for `WRITE_ECHO`."""
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
    """Make an echo from the columns that `READ_ECHOES` selects, from `sequence` on.

    Raises:
        TypeError, ValueError, OverflowError: The columns do not hold an echo.
    """
    if not isinstance(samples, bytes) or not isinstance(raw, bytes) or not isinstance(preamble, (str, type(None))):
        raise TypeError("samples, raw and preamble must be bytes, bytes and a text")
    counts = np.frombuffer(samples, "<i2").astype(np.int16, copy=False)
    if device_time is not None:
        return EchoFrame(sequence, index(device_time) % 2**64, int(period), scale, offset, counts, flags, raw)
    numbers = np.array([period, first_sample, scale, offset], dtype=np.float64)
    with np.errstate(over="ignore"):
        ends = numbers[1] + 1e-12 * numbers[0] * counts.size, abs(numbers[3]) + 65536.0 * abs(numbers[2])
    if not np.isfinite([*numbers, *ends]).all():
        raise ValueError(f"sample period, first sample, scale and offset {numbers.tolist()} are out of range")
    period, first_sample, scale, offset = numbers.tolist()  # converts a column that holds its number as a text
    return ScopeCurve(index(sequence), period, scale, offset, counts, first_sample, preamble or "", raw)


def label_of(text: str) -> dict[str, str]:
    """Parse a label as stored: a JSON object of texts.

    Raises:
        TypeError, ValueError: The text is anything else.
    """
    label = json.loads(text)
    if not isinstance(label, dict) or not all(isinstance(value, str) for value in label.values()):
        raise ValueError(f"a label is texts by their keys, got {text[:60]!r}")
    return label


def signed(value: int) -> int:
    """Return an unsigned 64-bit number as SQLite stores it: the same bits read as a signed number."""
    return value - 2**64 if value >= 2**63 else value
