"""An oscilloscope on a serial port: it is asked one question at a time, in the words of its dialect.

Curves are read one by one, and none twice. Where the instrument counts its acquisitions (Tektronix), the count is
asked before and after each curve, and those that came and went in between are known to be missing. Where it does not
(Rigol), single acquisitions are started from here. An instrument that can do neither is read as fast as it answers.
"""

import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from aerokernels.hardware.blocks import GREATEST_BLOCK_LENGTH, Block, BlockDecoder, TextLine
from aerokernels.hardware.decoder import DamagedPiece
from aerokernels.hardware.port import read_available
from aerokernels.hardware.preamble import Preamble, PreambleError, parse_rigol, parse_tektronix

if TYPE_CHECKING:
    import serial

_IDLE_TIME = 0.25  # [s] without a byte after which a response that went wrong is taken to be over
_GREATEST_DRAIN_TIME = 5.0  # [s]
_PROBE_TIME = 1.0  # [s] for a question that the instrument may not know


@dataclass(frozen=True)
class Dialect:
    """What to say to one family of oscilloscopes.

    Attributes:
        name: as on the command line.
        set_up: commands sent once.
        preamble: question for the scaling.
        curve: question for the samples.
        acquisition: question for the count of acquisitions, None where there is none.
        single: command that starts a single acquisition, question for its state, and command that ends this mode.
        parse: reads the answer to `preamble`.
    """

    name: str
    set_up: tuple[str, ...]
    preamble: str
    curve: str
    acquisition: str | None
    single: tuple[str, str, str] | None
    parse: Callable[[str], Preamble]


_TEKTRONIX = ("HEADER ON", "DATA:ENCDG RIBINARY")
DIALECTS = (
    Dialect("tektronix", _TEKTRONIX, "WFMOUTPRE?", "CURVE?", "ACQUIRE:NUMACQ?", None, parse_tektronix),
    # The TDS200, TDS1000 and TDS2000 families have only this name for it.
    Dialect("tektronix", _TEKTRONIX, "WFMPRE?", "CURVE?", "ACQUIRE:NUMACQ?", None, parse_tektronix),
    Dialect(
        "rigol",
        (":WAVEFORM:FORMAT BYTE",),
        ":WAVEFORM:PREAMBLE?",
        ":WAVEFORM:DATA?",
        None,
        (":SINGLE", ":TRIGGER:STATUS?", ":RUN"),
        parse_rigol,
    ),
)


class NoAnswerError(Exception):
    """The instrument did not answer in time."""


class DamagedAnswerError(Exception):
    """The answer was not what was asked for; what came is among the damaged pieces."""


class Oscilloscope:
    """Asks and listens.

    Args:
        port: the open port.
        timeout: longest silence before and within an answer [s].
        stopped: asked while waiting; True gives up at once.
    """

    def __init__(
        self, port: "serial.SerialBase", *, timeout: float = 3.0, stopped: Callable[[], bool] = lambda: False
    ) -> None:
        """Take the port; nothing is sent yet."""
        self._port, self._timeout, self._stopped = port, timeout, stopped
        self._decoder = BlockDecoder()
        self._damaged: list[DamagedPiece] = []
        self.heard_at = time.monotonic()
        """When the last byte came [s, monotonic]."""

    def send(self, command: str) -> None:
        """Send a command that has no answer."""
        self._port.write(command.encode("ascii") + b"\n")

    def ask_text(self, question: str, timeout: float | None = None) -> str:
        """The line of text that answers `question`.

        Raises:
            NoAnswerError: silence.
            DamagedAnswerError: something else came.
            OSError, termios.error: the port went away.
        """
        answer = self._ask(question, timeout)
        if isinstance(answer, Block):
            raise self._refused(answer.raw, f"text: a block in answer to {question}")
        return answer.text

    def ask_block(self, question: str) -> Block:
        """The block that answers `question`; raises what `ask_text` does."""
        answer = self._ask(question)
        if isinstance(answer, TextLine):
            raise self._refused(answer.text.encode("ascii"), f"block: a text in answer to {question}")
        return answer

    def refuse(self, block: Block, reason: str) -> None:
        """Count a block as damaged after all, and listen until the instrument is silent."""
        self._damaged.append(DamagedPiece(block.raw, reason))
        self._drain()

    def take_damaged(self) -> list[DamagedPiece]:
        """The damaged pieces since the last call."""
        found, self._damaged = self._damaged, []
        return found

    def pending(self, reason: str) -> list[DamagedPiece]:
        """The answer that was cut off, and damaged pieces not taken yet."""
        return self.take_damaged() + self._decoder.finish(reason)

    def _ask(self, question: str, timeout: float | None = None) -> TextLine | Block:
        self.send(question)
        wait = self._timeout if timeout is None else timeout
        until = time.monotonic() + wait
        # Every byte gives it more time, but an instrument that babbles must not hold us for ever.
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
            if answers or damaged:  # more than was asked for: who knows which is which
                for answer in answers:
                    raw = answer.raw if isinstance(answer, Block) else answer.text.encode("ascii")
                    self._damaged.append(DamagedPiece(raw, f"text: one of {len(answers)} answers to {question}"))
                self._drain()
                raise DamagedAnswerError
        cut_off = [] if self._stopped() else self._decoder.finish(f"cut off: no more came of the answer to {question}")
        self._damaged += cut_off
        raise DamagedAnswerError if cut_off else NoAnswerError

    def _refused(self, raw: bytes, reason: str) -> DamagedAnswerError:
        self._damaged.append(DamagedPiece(raw, reason))
        self._drain()
        return DamagedAnswerError()

    def _drain(self) -> None:
        """Listen until nothing comes any more, so that the next answer is to the next question."""
        until, last = time.monotonic() + _IDLE_TIME, time.monotonic() + _GREATEST_DRAIN_TIME
        while time.monotonic() < min(until, last) and not self._stopped():
            chunk = read_available(self._port)
            if chunk:
                until = time.monotonic() + _IDLE_TIME
                for piece in self._decoder.feed(chunk):
                    raw = piece.text.encode("ascii") if isinstance(piece, TextLine) else piece.raw
                    self._damaged.append(DamagedPiece(raw, "text: not asked for"))
        self._damaged += self._decoder.finish("cut off: not asked for")


def find_dialect(scope: Oscilloscope, name: str = "auto") -> tuple[Dialect, Preamble]:
    """The dialect that the instrument answers in, set up, and its preamble.

    Args:
        scope: the instrument.
        name: "auto", or the name of one of `DIALECTS`.

    Raises:
        NoAnswerError: it answers in none; the message says what came instead.
        OSError, termios.error: the port went away.
    """
    why = "no answer"
    for dialect in DIALECTS:
        if name not in ("auto", dialect.name):
            continue
        for command in dialect.set_up:
            scope.send(command)
        for _ in range(2):  # the first answer may be mixed with what was on the line before
            try:
                return dialect, dialect.parse(scope.ask_text(dialect.preamble))
            except NoAnswerError:
                break
            except DamagedAnswerError:
                why = f"damaged answer to {dialect.preamble}"
            except PreambleError as error:
                why = str(error)
    raise NoAnswerError(why)


def can_answer(scope: Oscilloscope, question: str, words: str) -> bool:
    """Whether the instrument knows a question: the last word of its answer matches the expression `words`."""
    for _ in range(2):
        try:
            return re.fullmatch(words, scope.ask_text(question, _PROBE_TIME).split()[-1].upper()) is not None
        except NoAnswerError:
            break
        except DamagedAnswerError:
            continue
    return False
