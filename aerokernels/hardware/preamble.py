"""Parse the preambles of oscilloscopes, which scale the bytes of a curve to volts and seconds.

Tektronix (`WFMOUTPRE?`, named fields):   volts = YZERO + YMULT (y - YOFF),   t = XZERO + XINCR (k - PT_OFF)
Rigol (`:WAVEFORM:PREAMBLE?`, ten numbers): volts = (y - yorigin - yreference) yincrement,
                                            t = xorigin + xincrement (k - xreference)

References: Tektronix, programmer manuals of the TDS2000, TDS5000B and DPO4000 series; Rigol, programming guides of the
DS1000Z and DS4000E series.
"""

import math
import re
import zlib
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from aerokernels.hardware.frames import Waveform, as_counts, as_whole
from aerokernels.inputs.checks import check_at_least

# Full names of the fields, and the least length to which an instrument abbreviates them (VERBOSE OFF).
_TEKTRONIX_FIELDS = {
    "BYT_NR": 5, "BIT_NR": 5, "ENCDG": 3, "BN_FMT": 4, "BYT_OR": 5, "NR_PT": 4, "PT_FMT": 4, "PT_OFF": 4,
    "XINCR": 3, "XZERO": 3, "YMULT": 3, "YOFF": 3, "YZERO": 3,
}  # fmt: skip
_RIGOL_FIELDS = (
    "format", "type", "points", "count", "xincrement", "xorigin", "xreference", "yincrement", "yorigin", "yreference",
)  # fmt: skip


class PreambleError(ValueError):
    """A preamble cannot be used; the message is the reason."""


@dataclass(frozen=True)
class Preamble:
    """The scaling of a curve.

    Attributes:
        text: the preamble as the instrument sent it.
        sample_type: NumPy type of a sample in the block.
        sample_count: number of samples in the block; None when the preamble does not tell.
        sample_period: time between two samples [s].
        first_sample_time: time of the first sample after the trigger [s].
        scale: [V/count].
        offset: voltage of a count of zero [V].
    """

    text: str
    sample_type: str
    sample_count: int | None
    sample_period: float
    first_sample_time: float
    scale: float
    offset: float

    def __post_init__(self) -> None:
        """Check that the numbers are finite, that scale and period are not 0, and that nothing overflows."""
        for name in ("sample_period", "first_sample_time", "scale", "offset"):
            if not math.isfinite(getattr(self, name)):
                raise PreambleError(f"preamble: {name} = {getattr(self, name)}")
        # Volts of the widest count and the time [ps] of the last of more samples than a block holds must not overflow.
        furthest = abs(self.first_sample_time) + 1e12 * self.sample_period * 2**32
        if not math.isfinite(abs(self.offset) + 65536.0 * abs(self.scale)) or not math.isfinite(furthest):
            raise PreambleError(f"preamble: {self.scale} V per count every {self.sample_period} s is out of range")
        if self.scale == 0.0 or self.sample_period <= 0.0:
            raise PreambleError(f"preamble: {self.scale} V per count every {self.sample_period} s")
        if self.sample_count is not None and self.sample_count < 1:
            raise PreambleError(f"preamble: {self.sample_count} samples")

    def agrees(self, other: "Preamble") -> bool:
        """Whether two preambles scale counts alike; the time of the first sample may differ by less than a sample."""
        same = all(
            getattr(self, name) == getattr(other, name)
            for name in ("sample_type", "sample_count", "sample_period", "scale", "offset")
        )
        return same and abs(self.first_sample_time - other.first_sample_time) < self.sample_period

    def curve(self, data: bytes, raw: bytes, sequence: int | None) -> "ScopeCurve":
        """Return the curve in the block `data`, whose length must be the preamble's."""
        width = np.dtype(self.sample_type).itemsize
        if len(data) % width or (self.sample_count is not None and len(data) != width * self.sample_count):
            raise PreambleError(f"length: {len(data)} bytes for {self.sample_count} samples of {width}")
        counts, offset = np.frombuffer(data, self.sample_type), self.offset
        if counts.dtype.kind == "u" and width == 2:  # shift to int16, which cannot hold the upper half
            counts, offset = counts.astype(np.int32) - 32768, offset + 32768 * self.scale
        period = 1e12 * self.sample_period
        return ScopeCurve(
            sequence,
            # A decimal number of nanoseconds gives a whole number of picoseconds, despite binary rounding.
            round(period) if math.isclose(period, round(period), rel_tol=1e-12) else period,
            self.scale,
            offset,
            counts.astype(np.int16),
            self.first_sample_time,
            self.text,
            raw,
        )


@dataclass(frozen=True, eq=False)
class ScopeCurve(Waveform):
    """One curve of an oscilloscope, with its preamble as the instrument sent it, and the block as received (raw).

    `sequence` is the instrument's count of acquisitions; None where it has no count, and the store numbers the curve.
    An oscilloscope sends no clock and no flags.
    """

    sequence: int | None
    sample_period_ps: float
    scale: float
    offset: float
    samples: np.ndarray
    first_sample_time: float
    preamble: str = ""
    raw: bytes = field(default=b"", repr=False)
    device_time_us: None = None
    flags: int = 0

    def __post_init__(self) -> None:
        """Check that the numbers are finite, and the samples one row of 16-bit counts."""
        if self.sequence is not None:
            object.__setattr__(self, "sequence", as_whole(self.sequence, "sequence"))
        for name in ("sample_period_ps", "scale", "offset", "first_sample_time"):
            value = getattr(self, name)
            number = check_at_least(value, name)
            # A whole number of picoseconds stays one: the store then holds it as a whole number.
            object.__setattr__(self, name, value if isinstance(value, int) else number)
        object.__setattr__(self, "samples", as_counts(self.samples))

    @cached_property
    def crc(self) -> int:
        """CRC-32 of the block, computed here because the protocol has none."""
        return zlib.crc32(self.raw)


def parse_tektronix(text: str) -> Preamble:
    """Parse the preamble of a Tektronix oscilloscope: `NAME value` pairs between semicolons, in any order.

    Fields that older instruments leave out get their usual values: one signed byte a sample, no offsets.
    """
    fields: dict[str, str] = {}
    for part in re.findall(r'(?:[^;"]|"[^"]*"?)+', text):
        words = part.split(None, 1)
        if len(words) == 2:
            short = words[0].rpartition(":")[2].upper()
            for name, least in _TEKTRONIX_FIELDS.items():
                if name.startswith(short) and len(short) >= least:
                    fields[name] = words[1].strip()
    missing = {"YMULT", "XINCR"} - set(fields)
    if missing:
        raise PreambleError(f"preamble: no {' and no '.join(sorted(missing))} in {text[:200]!r}")
    if fields.get("ENCDG", "BIN").upper().startswith("ASC"):
        raise PreambleError("preamble: the instrument sends numbers as text; set DATA:ENCDG RIBINARY on it")
    if fields.get("PT_FMT", "Y").upper() != "Y":
        raise PreambleError(f"preamble: PT_FMT {fields['PT_FMT']}; set the acquisition to single points (sample mode)")
    kind = {"RI": "i", "RP": "u"}.get(fields.get("BN_FMT", "RI").upper())
    width = _number(fields, "BYT_NR", 1)
    if kind is None or width not in (1, 2):
        raise PreambleError(
            f"preamble: {fields.get('BN_FMT')} of {width} bytes; set DATA:ENCDG RIBINARY and WIDTH 1 or 2"
        )
    order = "<" if fields.get("BYT_OR", "MSB").upper() == "LSB" else ">"
    scale, period = _number(fields, "YMULT"), _number(fields, "XINCR")
    return Preamble(
        text,
        f"{order}{kind}{int(width)}",
        int(_number(fields, "NR_PT")) if "NR_PT" in fields else None,
        period,
        _number(fields, "XZERO", 0.0) - _number(fields, "PT_OFF", 0.0) * period,
        scale,
        _number(fields, "YZERO", 0.0) - scale * _number(fields, "YOFF", 0.0),
    )


def parse_rigol(text: str) -> Preamble:
    """Parse the preamble of a Rigol oscilloscope: ten numbers between commas."""
    values = re.sub(r"^\s*:?[A-Za-z][\w:]*\s+", "", text).split(",")
    if len(values) != len(_RIGOL_FIELDS):
        raise PreambleError(f"preamble: {len(values)} values instead of {len(_RIGOL_FIELDS)} in {text[:200]!r}")
    number = {name: _number(dict(zip(_RIGOL_FIELDS, values, strict=True)), name) for name in _RIGOL_FIELDS}
    sample_type = {0: "u1", 1: "<u2"}.get(int(number["format"]))
    if sample_type is None:
        raise PreambleError("preamble: the instrument sends numbers as text; set :WAVEFORM:FORMAT BYTE on it")
    scale = number["yincrement"]
    return Preamble(
        text,
        sample_type,
        int(number["points"]),
        number["xincrement"],
        number["xorigin"] - number["xreference"] * number["xincrement"],
        scale,
        -scale * (number["yorigin"] + number["yreference"]),
    )


def _number(fields: dict[str, str], name: str, default: float | None = None) -> float:
    if default is not None and name not in fields:
        return default
    try:
        value = float(fields[name])
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise PreambleError(f"preamble: {name} = {fields[name][:40]!r} is no number")
    return value
