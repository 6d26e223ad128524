"""The recording loop: bytes from a port, through the decoder, into the store, until a count or a stop."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from aerokernels.hardware.decoder import DamagedPiece, FrameDecoder
from aerokernels.hardware.frames import EchoFrame
from aerokernels.hardware.port import PortError
from aerokernels.hardware.store import EchoStore

if TYPE_CHECKING:
    import serial

FIRST_WAIT = 0.1
GREATEST_WAIT = 5.0
"""Waits between attempts to reopen a lost port [s]: doubled from the first to the greatest."""


@dataclass(frozen=True)
class RecordingStatus:
    """What is on the disk (a status is made after a commit, never before).

    Attributes:
        stored_count: echoes stored in this recording.
        duplicate_count: good frames that the store already had.
        damaged_count: damaged pieces kept.
        missing_count: frames the sequence numbers say were sent and did not arrive.
        reconnect_count: times the port was lost and opened again.
        last_sequence: number of the last echo stored, None before the first.
        last_peak: greatest voltage of the last echo [V].
        port_open: False while the port is away.
    """

    stored_count: int = 0
    duplicate_count: int = 0
    damaged_count: int = 0
    missing_count: int = 0
    reconnect_count: int = 0
    last_sequence: int | None = None
    last_peak: float | None = None
    port_open: bool = True


class Recorder:
    """Records frames v1 from a port into a store.

    Args:
        port: the open port; the recorder closes it.
        store: where the echoes go; `begin_recording` has been called.
        reopen: opens the port again, or raises PortError; called with back-off after the port was lost.
        count: echoes to store before stopping; None records until `stopped`.
        commit_interval: longest time a frame waits for its commit [s]; it bounds what a kill loses.
        batch_size: most frames and pieces between two commits.
        stopped: asked between reads; True ends the recording.
        report: called with the status after each commit and whenever the port goes or comes back.
    """

    def __init__(
        self,
        port: "serial.SerialBase",
        store: EchoStore,
        reopen: Callable[[], "serial.SerialBase"],
        *,
        count: int | None = None,
        commit_interval: float = 0.25,
        batch_size: int = 256,
        stopped: Callable[[], bool] = lambda: False,
        report: Callable[[RecordingStatus], None] = lambda status: None,
    ) -> None:
        """Check the arguments; `run` records."""
        if count is not None and count < 1:
            raise ValueError(f"count = {count}: give 1 or more, or leave it out to record until interrupted")
        self._port, self._store, self._reopen, self._count = port, store, reopen, count
        self._commit_interval, self._batch_size = commit_interval, batch_size
        self._stopped, self._report = stopped, report
        self._decoder = FrameDecoder()
        self._status = RecordingStatus()
        self._batch_count, self._batch_since = 0, 0.0

    def run(self) -> RecordingStatus:
        """Record; returns what was stored. A port that is lost on the way is waited for."""
        port: serial.SerialBase | None = self._port
        while port is not None:
            lost = not self._record_from(port)
            _close(port)
            if not lost:
                break
            for piece in self._decoder.finish("cut off: the port was lost"):
                self._take(piece, time.time_ns())
            self._status = replace(self._status, port_open=False)
            self._commit()
            port = self._reconnect()
        self._commit()
        return self._status

    def _record_from(self, port: "serial.SerialBase") -> bool:
        """Record until the count or a stop (True), or until the port is lost (False)."""
        while not (self._done() or self._stopped()):
            try:
                chunk = port.read(max(1, port.in_waiting))
            except OSError:  # SerialException is one
                return False
            host_time = time.time_ns()
            for piece in self._decoder.feed(chunk):
                self._take(piece, host_time)
                if self._done():
                    break
            if self._batch_count and time.monotonic() - self._batch_since >= self._commit_interval:
                self._commit()
        return True

    def _take(self, piece: EchoFrame | DamagedPiece, host_time: int) -> None:
        if not self._batch_count:
            self._batch_since = time.monotonic()
        self._batch_count += 1
        status = self._status
        if not isinstance(piece, EchoFrame):
            self._store.add_damaged(piece, host_time)
            self._status = replace(status, damaged_count=status.damaged_count + 1)
        elif not self._store.add(piece, host_time):
            self._status = replace(status, duplicate_count=status.duplicate_count + 1)
        else:
            missing = 0 if status.last_sequence is None else (piece.sequence - status.last_sequence - 1) % 2**32
            self._status = replace(
                status,
                stored_count=status.stored_count + 1,
                # Half the number range and more is no gap: the board started again.
                missing_count=status.missing_count + (missing if missing < 2**31 else 0),
                last_sequence=piece.sequence,
                last_peak=float(piece.voltage.max()) if piece.samples.size else None,
            )
        if self._batch_count >= self._batch_size:
            self._commit()

    def _commit(self) -> None:
        self._store.commit()
        self._batch_count = 0
        self._report(self._status)

    def _done(self) -> bool:
        return self._count is not None and self._status.stored_count >= self._count

    def _reconnect(self) -> "serial.SerialBase | None":
        """The port again, however long it stays away; None when the recording was stopped meanwhile."""
        wait = FIRST_WAIT
        while not self._stopped():
            # Waiting comes first: a port that opens and fails at once must not be asked without a pause.
            until = time.monotonic() + wait
            while time.monotonic() < until and not self._stopped():
                time.sleep(min(0.1, wait))
            wait = min(2.0 * wait, GREATEST_WAIT)
            try:
                port = self._reopen()
            except PortError:
                continue
            self._status = replace(self._status, reconnect_count=self._status.reconnect_count + 1, port_open=True)
            self._report(self._status)
            return port
        return None


def _close(port: "serial.SerialBase") -> None:
    try:
        port.close()
    except OSError:
        pass  # a device that is gone may refuse even this
