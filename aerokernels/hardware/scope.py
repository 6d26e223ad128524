"""Query an oscilloscope on a serial port, one question at a time, in the commands of its dialect.

Its output is lines of text, which end with a line feed, and definite-length blocks of IEEE 488.2-1992, 8.7.9: `#`, one
digit d (1 to 9), d digits that give a count, and then that many bytes of any value, as in

    :CURVE #42500<2500 bytes><line feed>

Only the count determines where a block ends: a line feed among the data is data.

Curves are read one by one, and none twice. Where the instrument counts its acquisitions (Tektronix), the count is
queried before and after each curve, which shows how many acquisitions were missed. Where it does not (Rigol), each
single acquisition is started from here. An instrument that supports neither is read as fast as it answers.
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

# Greatest length of a line of text [bytes]; a preamble has some 300.
GREATEST_TEXT_LENGTH = 4096

_SPECIAL = re.compile(rb'[\n#"]')

_TEXT = re.compile(rb"[\x20-\x7e\t]*")

_RESPONSE_HEADER = re.compile(rb"[\s;]*(:?[A-Za-z][A-Za-z0-9_:]*)?[ \t]*")


@dataclass(frozen=True)
class TextLine:
    """A line of text, without its line end."""

    text: str


@dataclass(frozen=True)
class Block:
    """A definite-length block.

    Attributes:
        data: its content.
        raw: the bytes as received: response header, length and content.
    """

    data: bytes = field(repr=False)
    raw: bytes = field(repr=False)


class BlockDecoder:
    """Turns a stream of bytes, in chunks of any size, into text lines, blocks and damaged pieces.

    The result does not depend on how the bytes are cut into chunks, and the time is linear in their number. The decoder
    buffers at most `greatest_length` + 2 `GREATEST_TEXT_LENGTH` bytes.
    """

    def __init__(self, greatest_length: int = GREATEST_BLOCK_LENGTH) -> None:
        """Start between two responses."""
        self._greatest_length = greatest_length
        self._found: list[TextLine | Block | DamagedPiece] = []
        self._begin()

    def _begin(self) -> None:
        self._pending = bytearray()
        self._hash = -1  # index of `#` in the pending bytes while its digits arrive, else -1
        self._wanted = 0  # bytes of the block that have not arrived yet
        self._data_start = 0
        self._quoted = False
        self._overlong = False

    @property
    def pending_length(self) -> int:
        """Number of buffered bytes of an incomplete line or block."""
        return len(self._pending)

    def feed(self, chunk: bytes) -> list[TextLine | Block | DamagedPiece]:
        """Take the next bytes; return the lines, blocks and damaged pieces that they complete, in order."""
        chunk, position = bytes(chunk), 0
        while position < len(chunk):
            if self._wanted:
                position = self._take_data(chunk, position)
            elif self._hash >= 0:
                position = self._take_length(chunk, position)
            else:
                position = self._take_text(chunk, position)
        found, self._found = self._found, []
        return found

    def finish(self, reason: str = "cut off: the stream ended before its end") -> list[DamagedPiece]:
        """End the stream: return the pending bytes as a damaged piece, and reset the decoder."""
        raw = bytes(self._pending)
        self._begin()
        return [DamagedPiece(raw, reason)] if raw.strip() else []

    def _take_data(self, chunk: bytes, position: int) -> int:
        piece = chunk[position : position + self._wanted]
        self._pending += piece
        self._wanted -= len(piece)
        if not self._wanted:
            self._end_block()
        return position + len(piece)

    def _take_length(self, chunk: bytes, position: int) -> int:
        """Take one byte of `#<digit><digits>`; any other byte makes the `#` a character of a text."""
        byte = chunk[position : position + 1]
        digits = bytes(self._pending[self._hash + 1 :]) + byte
        if not byte.isdigit() or digits[:1] == b"0":
            self._hash = -1
            return position
        self._pending += byte
        if len(digits) == 1 + int(digits[:1]):
            self._wanted, self._data_start = int(digits[1:]), len(self._pending)
            if self._wanted > self._greatest_length:
                self._damaged(
                    bytes(self._pending), f"length: a block of {self._wanted} bytes, more than {self._greatest_length}"
                )
                self._begin()
            elif not self._wanted:
                self._end_block()
        return position + 1

    def _take_text(self, chunk: bytes, position: int) -> int:
        room = GREATEST_TEXT_LENGTH - len(self._pending)
        if room <= 0:
            self._damaged(bytes(self._pending), "length: no line end within the longest text")
            self._pending.clear()
            self._overlong = True
            return position
        special = _SPECIAL.search(chunk, position, position + room)
        if special is None:
            piece = chunk[position : position + room]
            self._pending += piece
            return position + len(piece)
        end = special.start()
        if special[0] == b"\n":
            self._pending += chunk[position:end]
            self._end_text()
        else:
            self._pending += chunk[position : end + 1]
            if special[0] == b'"':
                self._quoted = not self._quoted
            elif not self._quoted:
                self._hash = len(self._pending) - 1
        return end + 1

    def _end_text(self) -> None:
        raw = bytes(self._pending)
        text = raw.strip()
        if self._overlong and raw:
            self._damaged(raw, "length: no line end within the longest text")
        elif not _TEXT.fullmatch(text):
            self._damaged(raw, "text: bytes that are no ASCII characters")
        elif text:
            self._found.append(TextLine(text.decode("ascii")))
        self._begin()

    def _end_block(self) -> None:
        pending, start = bytes(self._pending), 0
        if self._overlong or not _RESPONSE_HEADER.fullmatch(pending, 0, self._hash):
            self._damaged(pending[: self._hash], "text: bytes before a block that are no response header")
            start = self._hash
        self._found.append(Block(pending[self._data_start :], pending[start:]))
        self._begin()

    def _damaged(self, raw: bytes, reason: str) -> None:
        if raw:
            self._found.append(DamagedPiece(raw, reason))


_IDLE_TIME = 0.25  # [s] without a byte after which an unexpected response is regarded as complete


_PROBE_TIME = 1.0  # [s] timeout of a question that the instrument may not know


@dataclass(frozen=True)
class Dialect:
    """Commands of one family of oscilloscopes.

    Attributes:
        name: the dialect's name on the command line.
        set_up: commands sent once.
        preamble: question for the scaling.
        curve: question for the samples.
        acquisition: question for the count of acquisitions, None where there is none.
        single: command that starts a single acquisition, question for its state, and command that ends this mode.
        parse: parser of the answer to `preamble`.
        maker: name in the answer to `*IDN?` without which the preamble is not believed; empty where its fields have
            names. Other makers send ten numbers too, and mean other volts by them.
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

    Args:
        port: the open port.
        timeout: longest silence before and within an answer [s].
        stopped: called while waiting; True gives up at once.
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
        """Send `question` and return the line of text that answers it.

        Raises:
            NoAnswerError: no answer came in time.
            DamagedAnswerError: the answer is not a line of text.
            OSError, termios.error: the port was lost.
        """
        answer = self._ask(question, timeout)
        if isinstance(answer, Block):
            raise self._rejected(answer.raw, f"text: a block in answer to {question}")
        return answer.text

    def ask_block(self, question: str) -> Block:
        """Send `question` and return the block that answers it; raises the errors of `ask_text`."""
        answer = self._ask(question)
        if isinstance(answer, TextLine):
            raise self._rejected(answer.text.encode("ascii"), f"block: a text in answer to {question}")
        return answer

    def reject(self, block: Block, reason: str) -> None:
        """Add a received block to the damaged pieces, and wait until the instrument is silent."""
        self._damaged.append(DamagedPiece(block.raw, reason))
        self._drain()

    def take_damaged(self) -> list[DamagedPiece]:
        """Return the damaged pieces since the last call."""
        found, self._damaged = self._damaged, []
        return found

    def pending(self, reason: str) -> list[DamagedPiece]:
        """Return the interrupted answer, and the damaged pieces not taken yet."""
        return self.take_damaged() + self._decoder.finish(reason)

    def _ask(self, question: str, timeout: float | None = None) -> TextLine | Block:
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
            found = self._decoder.feed(chunk)
            damaged = [piece for piece in found if isinstance(piece, DamagedPiece)]
            answers = [piece for piece in found if not isinstance(piece, DamagedPiece)]
            self._damaged += damaged
            if len(answers) == 1:
                return answers[0]
            if answers or damaged:  # several pieces: it is unknown which one is the answer
                for answer in answers:
                    raw = answer.raw if isinstance(answer, Block) else answer.text.encode("ascii")
                    self._damaged.append(DamagedPiece(raw, f"text: one of {len(answers)} answers to {question}"))
                self._drain()
                raise DamagedAnswerError
        cut_off = [] if self._stopped() else self._decoder.finish(f"cut off: no more came of the answer to {question}")
        self._damaged += cut_off
        raise DamagedAnswerError if cut_off else NoAnswerError

    def _rejected(self, raw: bytes, reason: str) -> DamagedAnswerError:
        self._damaged.append(DamagedPiece(raw, reason))
        self._drain()
        return DamagedAnswerError()

    def _drain(self) -> None:
        """Read until the instrument is silent, so that the next answer belongs to the next question."""
        until, last = time.monotonic() + _IDLE_TIME, time.monotonic() + 5.0
        while time.monotonic() < min(until, last) and not self._stopped():
            chunk = read_available(self._port)
            if chunk:
                until = time.monotonic() + _IDLE_TIME
                for piece in self._decoder.feed(chunk):
                    raw = piece.text.encode("ascii") if isinstance(piece, TextLine) else piece.raw
                    self._damaged.append(DamagedPiece(raw, "text: unexpected"))
        self._damaged += self._decoder.finish("cut off: unexpected")


def find_dialect(scope: Oscilloscope, name: str = "auto") -> tuple[Dialect, Preamble]:
    """Find the dialect that the instrument answers, send its set-up commands, and return it with the preamble.

    Args:
        scope: the instrument.
        name: "auto", or the name of one of `DIALECTS`, which counts where the instrument does not say its maker.

    Raises:
        NoAnswerError: the instrument answers no dialect, or its maker's scale of volts is not known; the message says
            what came instead.
        OSError, termios.error: the port was lost.
    """
    why, identity = "no answer", _identity(scope)
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
                return dialect, dialect.parse(scope.ask_text(dialect.preamble))
            except NoAnswerError:
                break
            except DamagedAnswerError:
                why = f"damaged answer to {dialect.preamble}"
            except PreambleError as error:
                why = str(error)
    raise NoAnswerError(why)


def _identity(scope: Oscilloscope) -> str:
    """Return the answer to `*IDN?`: maker, model, serial number, version; empty if there is none."""
    for _ in range(2):
        with suppress(DamagedAnswerError):
            try:
                return scope.ask_text("*IDN?", _PROBE_TIME)
            except NoAnswerError:
                break
    return ""


def can_answer(scope: Oscilloscope, question: str, words: str) -> bool:
    """Whether the instrument knows a question: the last word of its answer matches the regular expression `words`."""
    for _ in range(2):
        try:
            return re.fullmatch(words, scope.ask_text(question, _PROBE_TIME).split()[-1].upper()) is not None
        except NoAnswerError:
            break
        except DamagedAnswerError:
            continue
    return False
