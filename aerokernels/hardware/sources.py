"""Where echoes come from: a port and the protocol that is spoken on it, behind one small interface."""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

from aerokernels.hardware.decoder import DamagedPiece, FrameDecoder
from aerokernels.hardware.frames import EchoFrame
from aerokernels.hardware.port import PORT_ERRORS, PortError, close_port
from aerokernels.hardware.port_reader import PortReader
from aerokernels.hardware.preamble import PreambleError, ScopeCurve
from aerokernels.hardware.scope import (
    DamagedAnswerError,
    NoAnswerError,
    Oscilloscope,
    can_answer,
    find_dialect,
)

if TYPE_CHECKING:
    import serial

Piece = EchoFrame | ScopeCurve | DamagedPiece

_TRIGGER_STATES = "STOP|TD|WAIT|RUN|AUTO"
_NEXT_QUESTION = 0.02  # [s] between two looks whether there is a new acquisition


class EchoStream(Protocol):
    """An open port that gives echoes.

    Attributes:
        waits_long: a `poll` may wait for seconds, so that what came before it is to be committed first.
    """

    waits_long: bool

    @property
    def heard_at(self) -> float:
        """When the last byte came [s, monotonic]."""

    def poll(self) -> list[tuple[Piece, int]]:
        """What came since the last call, with the host time [ns since 1970]; waits a moment where nothing has.

        Raises:
            OSError, termios.error: the port went away.
        """

    def close(self) -> list[tuple[Piece, int]]:
        """Close the port; returns what had been read from it and was not handed out yet."""

    def cut_off(self, reason: str) -> list[DamagedPiece]:
        """The piece that is not complete and never will be."""


class FrameStream:
    """Frames v1: the board sends of its own accord.

    Args:
        port: the open port; closed by `close`.
    """

    waits_long = False

    def __init__(self, port: "serial.SerialBase") -> None:
        """Start listening."""
        self._port = port
        self._decoder = FrameDecoder()
        self.heard_at = time.monotonic()
        self._reader = PortReader(port)

    def poll(self) -> list[tuple[Piece, int]]:
        """Frames and damaged pieces since the last call."""
        item = self._reader.next()
        if item is None:
            return []
        self.heard_at = time.monotonic()
        chunk, host_time = item
        return [(piece, host_time) for piece in self._decoder.feed(chunk)]

    def close(self) -> list[tuple[Piece, int]]:
        """Close the port and hand out the rest of what had come in."""
        self._reader.stop()
        close_port(self._port)
        found: list[tuple[Piece, int]] = []
        try:
            while (item := self._reader.next(timeout=0.0)) is not None:
                found += [(piece, item[1]) for piece in self._decoder.feed(item[0])]
        except PORT_ERRORS:
            pass  # why it is being closed
        return found

    def cut_off(self, reason: str) -> list[DamagedPiece]:
        """The frame whose end never came."""
        return list(self._decoder.finish(reason))


class CurveStream:
    """Curves of an oscilloscope, asked for one by one.

    Args:
        port: the open port; closed by `close`, and here when the instrument does not answer.
        dialect: "auto", "tektronix" or "rigol".
        timeout: longest silence before and within an answer [s].
        stopped: asked while waiting; True gives up at once.

    Raises:
        PortError: the instrument does not answer as an oscilloscope does.
    """

    waits_long = True

    def __init__(
        self,
        port: "serial.SerialBase",
        *,
        dialect: str = "auto",
        timeout: float = 3.0,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        """Find out what the instrument speaks."""
        self._port = port
        self._scope = Oscilloscope(port, timeout=timeout, stopped=stopped)
        self._last_count: int | None = None
        self._started = False  # a single acquisition
        try:
            self._dialect, _ = find_dialect(self._scope, dialect)
            count, single = self._dialect.acquisition, self._dialect.single
            self._count_question = count if count and can_answer(self._scope, count, r"\d+") else None
            self._single = single if single and can_answer(self._scope, single[1], _TRIGGER_STATES) else None
        except NoAnswerError as error:
            close_port(port)
            raise PortError(
                f"port {port.port!r}: no oscilloscope ({error}): switch it on, set its line rate and terminator LF, "
                "and give --baud, --flow and --dialect as it has them"
            ) from error
        except PORT_ERRORS as error:
            close_port(port)
            raise PortError(f"port {port.port!r}: {error}") from error

    @property
    def heard_at(self) -> float:
        """When the last byte came [s, monotonic]."""
        return self._scope.heard_at

    def poll(self) -> list[tuple[Piece, int]]:
        """The next curve, and damaged answers on the way; nothing while there is no new acquisition."""
        found: list[tuple[Piece, int]] = []
        try:
            found = self._next_curve()
        except (NoAnswerError, DamagedAnswerError):
            pass  # asked again next time; a silent instrument is the recorder's matter
        damaged = self._scope.take_damaged()
        return [(piece, time.time_ns()) for piece in damaged] + found

    def close(self) -> list[tuple[Piece, int]]:
        """Let the instrument run again and close the port; nothing is kept back."""
        if self._single and self._port.is_open:
            try:
                self._scope.send(self._single[2])
            except PORT_ERRORS:
                pass
        close_port(self._port)
        return []

    def cut_off(self, reason: str) -> list[DamagedPiece]:
        """The answer whose end never came."""
        return self._scope.pending(reason)

    def _next_curve(self) -> list[tuple[Piece, int]]:
        count = self._acquisition()
        if (count is not None and count == self._last_count) or not self._is_complete():
            time.sleep(_NEXT_QUESTION)
            return []
        # Asked each time: a turned knob changes it, and on some instruments each trigger does.
        text = self._scope.ask_text(self._dialect.preamble)
        block = self._scope.ask_block(self._dialect.curve)
        host_time = time.time_ns()
        try:
            curve = self._dialect.parse(text).curve(block.data, block.raw, count)
        except PreambleError as error:
            self._scope.refuse(block, str(error))
            raise DamagedAnswerError from error
        self._started = False
        # What was acquired while the curve was read cannot be told from it: the next one is newer.
        self._last_count = count
        try:
            self._last_count = self._acquisition()
        except (NoAnswerError, DamagedAnswerError):
            pass
        return [(curve, host_time)]

    def _acquisition(self) -> int | None:
        """How many acquisitions there were; None where the instrument does not count them."""
        if self._count_question is None:
            return None
        return _last_number(self._scope.ask_text(self._count_question)) % 2**32

    def _is_complete(self) -> bool:
        """Whether the single acquisition is there; starts one where none was started."""
        if self._single is None:
            return True
        start, state, _ = self._single
        if not self._started:
            self._scope.send(start)
            self._started = True
        return self._scope.ask_text(state).split()[-1].upper() == "STOP"


def _last_number(answer: str) -> int:
    """The number in ":ACQUIRE:NUMACQ 12", or in "12" alone."""
    try:
        return int(answer.split()[-1])
    except ValueError as error:
        raise DamagedAnswerError from error
