"""Streams of echoes: a port and its protocol behind one small interface, by which the recorder reads any instrument.

`poll` returns the pieces since the last call with their host time [ns since 1970], and waits briefly if there are none.
`close` closes the port and returns pieces that were read and not returned; `cut_off` the piece whose rest never comes.
"""

import re
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING

from aerokernels.hardware.frames import DamagedPiece, EchoFrame, FrameDecoder
from aerokernels.hardware.port import PORT_ERRORS, PortError, PortReader, close_port
from aerokernels.hardware.preamble import PreambleError, ScopeCurve
from aerokernels.hardware.scope import DamagedAnswerError, NoAnswerError, Oscilloscope, find_dialect, probe

if TYPE_CHECKING:
    import serial

Piece = EchoFrame | ScopeCurve | DamagedPiece


class FrameStream:
    """Frames v1, which the board sends unprompted."""

    waits_long = False  # whether a `poll` may wait for seconds, so that earlier echoes are committed first

    def __init__(self, port: "serial.SerialBase") -> None:
        """Start reading."""
        self._port = port
        self._decoder = FrameDecoder()
        self.heard_at = time.monotonic()
        self._reader = PortReader(port)

    def poll(self) -> list[tuple[Piece, int]]:
        """Return the frames and damaged pieces since the last call; an error of the port is raised."""
        item = self._reader.next()
        if item is None:
            return []
        self.heard_at = time.monotonic()
        chunk, host_time = item
        return [(piece, host_time) for piece in self._decoder.feed(chunk)]

    def close(self) -> list[tuple[Piece, int]]:
        """Close the port and return the frames that had arrived."""
        self._reader.stop()
        close_port(self._port)
        pieces: list[tuple[Piece, int]] = []
        with suppress(*PORT_ERRORS):  # the recorder closes the port because of this error
            while (item := self._reader.next(timeout=0.0)) is not None:
                pieces += [(piece, item[1]) for piece in self._decoder.feed(item[0])]
        return pieces

    def cut_off(self, reason: str) -> list[DamagedPiece]:
        """Return the frame whose end never came."""
        return list(self._decoder.finish(reason))


class CurveStream:
    """Curves of an oscilloscope, queried one by one, and none twice.

    Where the instrument counts its acquisitions (Tektronix), the count is queried before and after each curve, which
    shows how many were missed. Where it does not (Rigol), each single acquisition is started from here. An instrument
    that supports neither is read as fast as it answers; one that does not answer at all is a PortError.
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
        """Find the instrument's dialect."""
        self._port = port
        self._scope = Oscilloscope(port, timeout=timeout, stopped=stopped)
        self._last_count: int | None = None
        self._started = False  # whether a single acquisition was started
        try:
            self._dialect = find_dialect(self._scope, dialect)
            count, single = self._dialect.acquisition, self._dialect.single
            self._count_question = count if count and re.search(r"(^|\s)\d+$", probe(self._scope, count)) else None
            states = r"(^|\s)(STOP|TD|WAIT|RUN|AUTO)$"
            self._single = single if single and re.search(states, probe(self._scope, single[1]).upper()) else None
        except NoAnswerError as error:
            close_port(port)
            raise PortError(
                f"port {port.port!r}: no oscilloscope ({error}): switch it on, set its line rate and terminator LF, "
                "and give line rate (baud), flow control and dialect as it has them"
            ) from error
        except PORT_ERRORS as error:
            close_port(port)
            raise PortError(f"port {port.port!r}: {error}") from error

    @property
    def heard_at(self) -> float:
        """Time of the last received byte [s, monotonic clock]."""
        return self._scope.heard_at

    def poll(self) -> list[tuple[Piece, int]]:
        """Return the next curve and damaged answers; nothing while there is no new acquisition."""
        curves: list[tuple[Piece, int]] = []
        with suppress(NoAnswerError, DamagedAnswerError):  # the next poll asks again
            curves = self._next_curve()
        return [*((piece, time.time_ns()) for piece in self._scope.take_damaged()), *curves]

    def close(self) -> list[tuple[Piece, int]]:
        """Let the instrument run again and close the port; there are never pieces left to return."""
        if self._single and self._port.is_open:
            with suppress(*PORT_ERRORS):
                self._scope.send(self._single[2])
        close_port(self._port)
        return []

    def cut_off(self, reason: str) -> list[DamagedPiece]:
        """Return the answer whose end never came."""
        return self._scope.pending(reason)

    def _next_curve(self) -> list[tuple[Piece, int]]:
        count = self._acquisition()
        if (count is not None and count == self._last_count) or not self._is_complete():
            time.sleep(0.02)  # between two questions whether there is a new acquisition
            return []
        # Queried each time: the operator may change the scale, and on some instruments each trigger changes it. Queried
        # again after the curve: a scale that was changed in between belongs to the curve, or does not.
        text = self._scope.ask_text(self._dialect.preamble)
        block = self._scope.ask_block(self._dialect.curve)
        host_time = time.time_ns()
        try:
            preamble = self._dialect.parse(text)
            curve = preamble.curve(block.data, block.raw, count)
            if not preamble.agrees(self._dialect.parse(self._scope.ask_text(self._dialect.preamble))):
                raise PreambleError("preamble: the scale changed while the curve was read")
        except (NoAnswerError, DamagedAnswerError):
            self._scope.reject(block, "preamble: none came after the curve")
            raise
        except PreambleError as error:
            self._scope.reject(block, str(error))
            raise DamagedAnswerError from error
        self._started = False
        # Acquisitions during the transfer cannot be told apart from this curve: only a higher count is a new one.
        self._last_count = count
        with suppress(NoAnswerError, DamagedAnswerError):
            self._last_count = self._acquisition()
        return [(curve, host_time)]

    def _acquisition(self) -> int | None:
        """Return the number of acquisitions so far; None where the instrument does not count them."""
        if self._count_question is None:
            return None
        try:  # ":ACQUIRE:NUMACQ 12", or "12" alone
            return int(self._scope.ask_text(self._count_question).split()[-1]) % 2**32
        except ValueError as error:
            raise DamagedAnswerError from error

    def _is_complete(self) -> bool:
        """Whether the single acquisition is complete; starts one if none was started."""
        if self._single is None:
            return True
        start, state, _ = self._single
        if not self._started:
            self._scope.send(start)
            self._started = True
        return self._scope.ask_text(state).split()[-1].upper() == "STOP"


EchoStream = FrameStream | CurveStream
