"""Query an oscilloscope on a serial port, one question at a time, in the commands of its dialect.

Answers are lines of text, or definite-length blocks of IEEE 488.2-1992, 8.7.9: `#`, one digit d, d digits that give a
count, and that many bytes of any value, a line feed among them. A header such as `:CURVE ` may precede the `#`.
"""

import re
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from aerokernels.hardware.frames import DamagedPiece
from aerokernels.hardware.port import read_available
from aerokernels.hardware.preamble import Preamble, PreambleError, parse_rigol, parse_tektronix

if TYPE_CHECKING:
    import serial

# Greatest count of bytes accepted; a damaged count must not make the decoder wait for gigabytes.
GREATEST_BLOCK_LENGTH = 32 * 2**20
GREATEST_TEXT_LENGTH = 4096  # [bytes] of a line of text; a preamble has some 300

# The response header, the `#` and the number of digits.
_BLOCK_START = re.compile(rb"[ \t\r;]{0,9}(?::?[A-Za-z][A-Za-z0-9_:]{0,80})?[ \t]{0,9}#([1-9])")


@dataclass(frozen=True)
class Block:
    """A definite-length block: its content, and the bytes as received, with response header and length."""

    data: bytes = field(repr=False)
    raw: bytes = field(repr=False)


class BlockDecoder:
    """Turns a stream of bytes, in chunks of any size, into texts (without line ends), blocks and damaged pieces."""

    def __init__(self, greatest_length: int = GREATEST_BLOCK_LENGTH) -> None:
        """Start between two answers."""
        self._greatest_length = greatest_length
        self._pending = bytearray()

    @property
    def pending_length(self) -> int:
        """Number of buffered bytes of an incomplete line or block."""
        return len(self._pending)

    def feed(self, chunk: bytes) -> list[str | Block | DamagedPiece]:
        """Take the next bytes; return the lines, blocks and damaged pieces that they complete, in order."""
        self._pending += chunk
        pieces = []
        while (piece := self._next()) is not None:
            pieces.append(piece)
        return [piece for piece in pieces if piece != ""]

    def finish(self, reason: str = "cut off: the stream ended before its end") -> list[DamagedPiece]:
        """End the stream: return the pending bytes as a damaged piece, and reset the decoder."""
        raw = self._take(len(self._pending))
        return [DamagedPiece(raw, reason)] if raw.strip() else []

    def _next(self) -> str | Block | DamagedPiece | None:
        """Take the first piece off the pending bytes; None if they hold no whole one."""
        pending = self._pending
        if start := _BLOCK_START.match(pending):
            data_start = start.end() + int(start[1])
            digits = bytes(pending[start.end() : data_start])
            if len(pending) < data_start and (digits.isdigit() or not digits):
                return None
            if len(pending) >= data_start and digits.isdigit():
                count = int(digits)
                if count > self._greatest_length:
                    reason = f"length: a block of {count} bytes, more than {self._greatest_length}"
                    return DamagedPiece(self._take(data_start), reason)
                if len(pending) < data_start + count:
                    return None
                raw = self._take(data_start + count)
                return Block(raw[data_start:], raw)
        end = pending.find(b"\n", 0, GREATEST_TEXT_LENGTH)
        if end < 0:
            if len(pending) < GREATEST_TEXT_LENGTH:
                return None
            return DamagedPiece(self._take(GREATEST_TEXT_LENGTH), "length: no line end within the longest text")
        raw = self._take(end + 1)[:-1]
        if not re.fullmatch(rb"[\x20-\x7e\t]*", raw.strip()):
            return DamagedPiece(raw, "text: bytes that are no ASCII characters")
        return raw.strip().decode("ascii")

    def _take(self, count: int) -> bytes:
        raw = bytes(self._pending[:count])
        del self._pending[:count]
        return raw


@dataclass(frozen=True)
class Dialect:
    """Commands of one family of oscilloscopes; questions for the scaling, the samples and the count of acquisitions.

    `single` starts a single acquisition, asks for its state, and ends this mode. Without the name of the `maker` in the
    answer to `*IDN?` the preamble is not believed: other makers send ten numbers too, and mean other volts by them.
    """

    name: str
    set_up: tuple[str, ...]
    preamble: str
    curve: str
    acquisition: str | None
    single: tuple[str, str, str] | None
    parse: Callable[[str], Preamble]
    maker: str = ""


_TEKTRONIX = ("HEADER ON", "DATA:ENCDG RIBINARY")

DIALECTS = (
    Dialect("tektronix", _TEKTRONIX, "WFMOUTPRE?", "CURVE?", "ACQUIRE:NUMACQ?", None, parse_tektronix),
    # The TDS200, TDS1000 and TDS2000 families know only this name of the preamble.
    Dialect("tektronix", _TEKTRONIX, "WFMPRE?", "CURVE?", "ACQUIRE:NUMACQ?", None, parse_tektronix),
    Dialect(
        "rigol",
        (":WAVEFORM:FORMAT BYTE",),
        ":WAVEFORM:PREAMBLE?",
        ":WAVEFORM:DATA?",
        None,
        (":SINGLE", ":TRIGGER:STATUS?", ":RUN"),
        parse_rigol,
        "RIGOL",
    ),
)


class NoAnswerError(Exception):
    """The instrument did not answer in time."""


class DamagedAnswerError(Exception):
    """The answer did not fit the question; the received bytes are among the damaged pieces."""


class Oscilloscope:
    """Sends commands and questions to an instrument, and reads its answers.

    `timeout` is the longest silence before and within an answer [s]; `stopped` gives up at once.
    """

    def __init__(
        self, port: "serial.SerialBase", *, timeout: float = 3.0, stopped: Callable[[], bool] = lambda: False
    ) -> None:
        """Store the port; send nothing yet."""
        self._port, self._timeout, self._stopped = port, timeout, stopped
        self._decoder = BlockDecoder()
        self._damaged: list[DamagedPiece] = []
        self.heard_at = time.monotonic()  # time of the last received byte [s, monotonic clock]

    def send(self, command: str) -> None:
        """Send a command that has no answer."""
        self._port.write(command.encode("ascii") + b"\n")

    def ask_text(self, question: str, timeout: float | None = None) -> str:
        """Send `question` and return the line of text that answers it; NoAnswerError or DamagedAnswerError without."""
        answer = self._ask(question, timeout)
        if isinstance(answer, Block):
            self.reject(answer, f"text: a block in answer to {question}")
            raise DamagedAnswerError
        return answer

    def ask_block(self, question: str) -> Block:
        """Send `question` and return the block that answers it."""
        answer = self._ask(question)
        if isinstance(answer, str):
            self.reject(answer, f"block: a text in answer to {question}")
            raise DamagedAnswerError
        return answer

    def reject(self, answer: str | Block | DamagedPiece, reason: str) -> None:
        """Add an answer to the damaged pieces, and all that follows it until the instrument is silent."""
        self._reject_one(answer, reason)
        idle = 0.25  # [s] without a byte after which an answer is regarded as complete
        until, last = time.monotonic() + idle, time.monotonic() + 5.0
        while time.monotonic() < min(until, last) and not self._stopped():
            chunk = read_available(self._port)
            if chunk:
                until = time.monotonic() + idle
                for piece in self._decoder.feed(chunk):
                    self._reject_one(piece, "text: unexpected")
        self._damaged += self._decoder.finish("cut off: unexpected")

    def _reject_one(self, answer: str | Block | DamagedPiece, reason: str) -> None:
        raw = answer.encode("ascii") if isinstance(answer, str) else answer.raw
        self._damaged.append(answer if isinstance(answer, DamagedPiece) else DamagedPiece(raw, reason))

    def take_damaged(self) -> list[DamagedPiece]:
        """Return the damaged pieces since the last call."""
        pieces, self._damaged = self._damaged, []
        return pieces

    def pending(self, reason: str) -> list[DamagedPiece]:
        """Return the interrupted answer, and the damaged pieces not taken yet."""
        return self.take_damaged() + self._decoder.finish(reason)

    def _ask(self, question: str, timeout: float | None = None) -> str | Block:
        self.send(question)
        wait = self._timeout if timeout is None else timeout
        until = time.monotonic() + wait
        # Every byte extends the wait, but an instrument that sends without end must not block for ever.
        last = until + 10.0 * GREATEST_BLOCK_LENGTH / max(1, self._port.baudrate)
        while time.monotonic() < min(until, last) and not self._stopped():
            chunk = read_available(self._port)
            if not chunk:
                continue
            self.heard_at = time.monotonic()
            until = self.heard_at + wait
            pieces = self._decoder.feed(chunk)
            if len(pieces) == 1 and not isinstance(pieces[0], DamagedPiece):
                return pieces[0]
            if pieces:  # it is unknown which of several is the answer
                for piece in pieces[:-1]:
                    self._reject_one(piece, f"text: one of {len(pieces)} answers to {question}")
                self.reject(pieces[-1], f"text: one of {len(pieces)} answers to {question}")
                raise DamagedAnswerError
        cut_off = [] if self._stopped() else self._decoder.finish(f"cut off: no more came of the answer to {question}")
        self._damaged += cut_off
        raise DamagedAnswerError if cut_off else NoAnswerError


def find_dialect(scope: Oscilloscope, name: str = "auto") -> Dialect:
    """Find the dialect ("auto": any) that the instrument answers, after sending its set-up commands.

    The message of a NoAnswerError says what came instead.
    """
    why, identity = "no answer", probe(scope, "*IDN?")
    for dialect in DIALECTS:
        if name not in ("auto", dialect.name):
            continue
        named = identity or (dialect.maker if name == dialect.name else "")  # an instrument that does not say its maker
        if dialect.maker not in named.split(",")[0].upper():
            if identity:
                why = f"{identity[:80]!r} is of a maker whose scale of volts is not known, of Tektronix and Rigol it is"
            continue
        for command in dialect.set_up:
            scope.send(command)
        for _ in range(2):  # the first answer may be mixed with earlier bytes on the line
            try:
                dialect.parse(scope.ask_text(dialect.preamble))
                return dialect
            except NoAnswerError:
                break
            except DamagedAnswerError:
                why = f"damaged answer to {dialect.preamble}"
            except PreambleError as error:
                why = str(error)
    raise NoAnswerError(why)


def probe(scope: Oscilloscope, question: str) -> str:
    """Return the answer to a question that the instrument may not know; empty if there is none."""
    for _ in range(2):
        with suppress(DamagedAnswerError):
            try:
                return scope.ask_text(question, timeout=1.0)
            except NoAnswerError:
                break
    return ""
