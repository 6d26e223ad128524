"""Encode and decode frame version 1 of a digitiser board.

On the wire a frame is COBS encoded (no zero byte inside) and ended by one 0x00. Decoded, little-endian:

    magic "AE" | version u8 = 1 | flags u8 | sequence u32 | device time u64 [us] | sample period u32 [ps]
    | scale f32 [V/count] | offset f32 [V] | sample count u16 | samples i16 ... | CRC-32 u32 of all bytes before it

    volts = offset + scale * sample

A frame is good only if the COBS code, the CRC-32, the magic, the version and the length are all correct.

References: S. Cheshire, M. Baker, "Consistent overhead byte stuffing", IEEE/ACM Trans. Networking 7 (1999) 159-172;
CRC-32 as in zlib (ISO-HDLC).
"""

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from operator import index
from typing import Any

import numpy as np
from cobs import cobs

from aerokernels.inputs.checks import check_at_least


class Waveform:
    """Counts of an analogue-to-digital converter as volts over time.

    volts = offset [V] + scale [V/count] * sample, int16, shape (sample_count,); the time of sample k is
    first_sample_time [s] + k * sample period [ps].
    """

    sample_period_ps: float
    scale: float
    offset: float
    samples: np.ndarray
    first_sample_time: float = 0.0

    @property
    def voltage(self) -> np.ndarray:
        """Samples as volts [V], float64, shape (sample_count,)."""
        return self.offset + self.scale * self.samples.astype(np.float64)

    @property
    def time(self) -> np.ndarray:
        """Time of each sample [s], float64, shape (sample_count,)."""
        return self.first_sample_time + np.arange(self.samples.size) * (self.sample_period_ps * 1e-12)

    @property
    def peak(self) -> float | None:
        """Greatest voltage [V]; None without samples."""
        if not self.samples.size:
            return None
        extreme = self.samples.max() if self.scale >= 0.0 else self.samples.min()
        return self.offset + self.scale * float(extreme)


def as_counts(samples: Any) -> np.ndarray:
    """Return counts as an int16 array of shape (sample_count,) that cannot be written to."""
    counts = np.asarray(samples)
    if counts.ndim != 1:
        raise ValueError(f"samples have shape {counts.shape}: give one row of counts")
    if counts.size and (counts.dtype.kind not in "iu" or counts.min() < -32768 or counts.max() > 32767):
        raise ValueError(f"samples of type {counts.dtype} do not fit int16: scale and round them to counts first")
    counts = counts.astype(np.int16)
    counts.flags.writeable = False
    return counts


def as_whole(value: Any, name: str) -> int:
    """Return a whole number as Python's own; raise a TypeError that names any other value."""
    try:
        return index(value)
    except TypeError:
        raise TypeError(f"{name} must be a whole number, got {value!r}") from None


MAGIC, VERSION, DELIMITER = b"AE", 1, b"\x00"
GREATEST_SAMPLE_COUNT = 0xFFFF
_HEADER, _CRC = struct.Struct("<2sBBIQIffH"), struct.Struct("<I")
_GREATEST_PAYLOAD = _HEADER.size + 2 * GREATEST_SAMPLE_COUNT + _CRC.size
# Bytes of the longest possible frame on the wire, without its delimiter.
GREATEST_FRAME_LENGTH = _GREATEST_PAYLOAD + _GREATEST_PAYLOAD // 254 + 1


class FrameError(ValueError):
    """The bytes between two delimiters are not a good frame."""


@dataclass(frozen=True, eq=False)
class EchoFrame(Waveform):
    """One recorded echo as the board sent it.

    Attributes:
        sequence: number of the frame, 0 to 2**32 - 1; it wraps, and starts again when the board does.
        device_time_us: the board's clock [us], 0 to 2**64 - 1.
        sample_period_ps: time between two samples [ps].
        scale: [V/count], rounded to float32.
        offset: [V], rounded to float32.
        samples: counts, int16, shape (sample_count,), read-only.
        flags: the board's flag byte, kept as it is.
        raw: the bytes as received (COBS encoded, no delimiter); empty for a frame that was not received.
    """

    sequence: int
    device_time_us: int
    sample_period_ps: int
    scale: float
    offset: float
    samples: np.ndarray
    flags: int = 0
    raw: bytes = field(default=b"", repr=False)

    def __post_init__(self) -> None:
        """Check that every field fits its place in the frame; a ValueError or TypeError names one that does not."""
        for name, bits in (("sequence", 32), ("device_time_us", 64), ("sample_period_ps", 32), ("flags", 8)):
            value = as_whole(getattr(self, name), name)
            object.__setattr__(self, name, value)
            if not 0 <= value < 1 << bits:
                raise ValueError(f"{name} = {value} does not fit its unsigned {bits}-bit field: use 0 to 2**{bits} - 1")
        for name in ("scale", "offset"):
            number = check_at_least(getattr(self, name), name)
            volts = float(np.float32(number)) if abs(number) <= float(np.finfo(np.float32).max) else math.inf
            if math.isinf(volts) or (number and not volts):
                raise ValueError(f"{name} = {number} is beyond float32: give volts that are not")
            object.__setattr__(self, name, volts)
        samples = as_counts(self.samples)
        if samples.size > GREATEST_SAMPLE_COUNT:
            raise ValueError(f"samples have shape {samples.shape}: a frame holds {GREATEST_SAMPLE_COUNT} at most")
        object.__setattr__(self, "samples", samples)

    @cached_property
    def crc(self) -> int:
        """The frame's CRC-32; together with sequence and device time it identifies the frame in a store."""
        return zlib.crc32(self._body())

    def _body(self) -> bytes:
        header = _HEADER.pack(
            MAGIC, VERSION, self.flags, self.sequence, self.device_time_us, self.sample_period_ps,
            self.scale, self.offset, self.samples.size,
        )  # fmt: skip
        return header + self.samples.astype("<i2").tobytes()


def encode(frame: EchoFrame) -> bytes:
    """Return the bytes of `frame` on the wire, its delimiter included."""
    body = frame._body()
    return cobs.encode(body + _CRC.pack(zlib.crc32(body))) + DELIMITER


def decode(raw: bytes) -> EchoFrame:
    """Decode the bytes received between two delimiters.

    Raises:
        FrameError: the bytes are not a good frame; the message is the reason.
    """
    try:
        payload = cobs.decode(raw)
    except cobs.DecodeError as error:
        raise FrameError(f"COBS: {error}") from None
    if len(payload) < _HEADER.size + _CRC.size:
        raise FrameError(f"length: {len(payload)} bytes, shorter than an empty frame")
    body = payload[: -_CRC.size]
    (crc,) = _CRC.unpack(payload[-_CRC.size :])
    if crc != zlib.crc32(body):
        raise FrameError("CRC: does not match")
    magic, version, flags, sequence, device_time, period, scale, offset, count = _HEADER.unpack_from(body)
    if magic != MAGIC:
        raise FrameError(f"magic: {magic!r}, expected {MAGIC!r}")
    if version != VERSION:
        raise FrameError(f"version: {version}, this decoder reads {VERSION}")
    if len(body) != _HEADER.size + 2 * count:
        raise FrameError(f"length: {len(body) - _HEADER.size} bytes of samples for a count of {count}")
    for name, value in (("scale", scale), ("offset", offset)):
        if not math.isfinite(value):
            raise FrameError(f"header: {name} = {value}, which is no voltage")
    samples = np.frombuffer(body, "<i2", offset=_HEADER.size).astype(np.int16, copy=False)
    frame = object.__new__(EchoFrame)  # without its checks: fields unpacked from a frame always fit
    frame.__dict__.update(
        sequence=sequence, device_time_us=device_time, sample_period_ps=period, scale=scale, offset=offset,
        samples=samples, flags=flags, raw=bytes(raw), crc=crc,
    )  # fmt: skip
    return frame


_OVERLONG = "length: no delimiter within the longest possible frame"


@dataclass(frozen=True)
class DamagedPiece:
    """Received bytes between two delimiters that are not a good frame, and the reason."""

    raw: bytes = field(repr=False)
    reason: str


class FrameDecoder:
    """Turns a stream of bytes, in chunks of any size, into good frames and damaged pieces.

    The result does not depend on how the bytes are cut into chunks. The decoder buffers at most `GREATEST_FRAME_LENGTH`
    bytes: a longer run without a delimiter becomes damaged pieces of that length.
    """

    def __init__(self) -> None:
        """Start between two frames."""
        self._pending = bytearray()
        self._overlong = False

    @property
    def pending_length(self) -> int:
        """Number of buffered bytes that wait for their delimiter."""
        return len(self._pending)

    def feed(self, chunk: bytes) -> list[EchoFrame | DamagedPiece]:
        """Take the next bytes; return the frames and damaged pieces that they complete, in order."""
        pieces: list[EchoFrame | DamagedPiece] = []
        *ended, unfinished = bytes(chunk).split(DELIMITER)
        for part in ended:
            self._pending += part
            pieces += self._overlong_pieces()
            if self._pending and not self._overlong:
                try:
                    pieces.append(decode(bytes(self._pending)))
                except FrameError as error:
                    pieces.append(DamagedPiece(bytes(self._pending), str(error)))
                self._pending.clear()
            pieces += self.finish()
        self._pending += unfinished
        return [*pieces, *self._overlong_pieces()]

    def finish(self, reason: str = "cut off: the stream ended before its delimiter") -> list[DamagedPiece]:
        """End the stream: return the pending bytes as a damaged piece, and reset the decoder."""
        raw, reason = bytes(self._pending), _OVERLONG if self._overlong else reason
        self._pending.clear()
        self._overlong = False
        return [DamagedPiece(raw, reason)] if raw else []

    def _overlong_pieces(self) -> Iterator[DamagedPiece]:
        """Take pieces of the greatest length off the pending bytes while they are longer."""
        while len(self._pending) > GREATEST_FRAME_LENGTH:
            yield DamagedPiece(bytes(self._pending[:GREATEST_FRAME_LENGTH]), _OVERLONG)
            del self._pending[:GREATEST_FRAME_LENGTH]
            self._overlong = True
