"""Convert echoes to rows of the store and back."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from operator import index
from typing import Any

import numpy as np

from aerokernels.hardware.frames import EchoFrame
from aerokernels.hardware.preamble import ScopeCurve

WRITE_ECHO = (
    "INSERT INTO echoes (recording, session, sequence, device_time_us, host_time_ns, label, flags, "
    "sample_period_ps, first_sample_s, scale, offset, sample_count, samples, crc32, preamble, raw) "
    "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?) "
    "ON CONFLICT (sequence, device_time_us, crc32) DO NOTHING"
)
READ_ECHOES = (
    "SELECT session, host_time_ns, label, sequence, device_time_us, sample_period_ps, first_sample_s, scale, offset, "
    "samples, flags, crc32, preamble, raw FROM echoes"
)


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


@dataclass(frozen=True)
class Gap:
    """Consecutive numbers of echoes that are missing in the store.

    Attributes:
        session: run of the board.
        after_sequence: last number before the gap.
        before_sequence: first number after it.
        missing_count: numbers missing in between.
    """

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


def stored_echo(session: Any, host_time: Any, text: Any, *columns: Any) -> StoredEcho:
    """Make an echo from all columns that `READ_ECHOES` selects; raises the errors of `echo_of` and `label_of`."""
    return StoredEcho(index(session), index(host_time), label_of(text), echo_of(*columns))


def encode_label(label: Mapping[str, str]) -> str:
    """Return a label as it is stored: JSON text with sorted keys, so that equal labels are equal texts.

    Raises:
        TypeError: the label is not texts by their keys, or holds characters that are not Unicode.
    """
    meant = 'a label is texts by their keys, such as {"mach": "3"}'
    if not isinstance(label, Mapping):
        raise TypeError(f"{meant}, got {label!r}")
    for text in (*label, *label.values()):
        if not isinstance(text, str) or re.search(r"[\ud800-\udfff]", text):
            raise TypeError(f"{meant}; {text!r} in {dict(label)!r} is none")
    return json.dumps(dict(label), sort_keys=True, ensure_ascii=False)


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
