"""The recording loop: store echoes from a port until a count or a stop, and reconnect whenever the port is lost."""

import contextlib
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from aerokernels.hardware.frames import DamagedPiece, Waveform
from aerokernels.hardware.port import PORT_ERRORS, PortError
from aerokernels.hardware.sources import EchoStream, Piece
from aerokernels.hardware.store import EchoStore
from aerokernels.inputs.checks import check_count
from aerokernels.inputs.kinds import is_number

# State of a port from which bytes come, but nothing that could be stored.
NO_GOOD_FRAME = "open, but no good frame yet: check the line rate (baud) and the protocol"
_NO_FRAME_TIME = 2.0  # [s] after which that is said
_REPORT_INTERVAL = 1.0  # [s] between two status reports while nothing is committed


@dataclass(frozen=True)
class RecordingStatus:
    """State of a recording; the counts are those of the last commit, so that they are on the disk.

    Attributes:
        stored_count: echoes stored in this recording.
        duplicate_count: good frames that the store already had.
        damaged_count: damaged pieces stored.
        missing_count: echoes that were measured but did not arrive, according to their numbers.
        reconnect_count: how often the port was lost and opened again.
        last_sequence: number of the last echo stored, None before the first.
        last_peak: greatest voltage of the last echo [V].
        port_state: "open", "silent" (open, but no bytes arrive), `NO_GOOD_FRAME`, or the reason why the port is lost.
    """

    stored_count: int = 0
    duplicate_count: int = 0
    damaged_count: int = 0
    missing_count: int = 0
    reconnect_count: int = 0
    last_sequence: int | None = None
    last_peak: float | None = None
    port_state: str = "open"

    @property
    def port_open(self) -> bool:
        """Whether the port is open."""
        return self.port_state in ("open", "silent", NO_GOOD_FRAME)


class Recorder:
    """Records echoes from a port into a store.

    Args:
        stream: the open port; the recorder closes it.
        store: the store for the echoes; `begin_recording` has been called.
        reconnect: opens the port again, or raises PortError; called with increasing waits after the port was lost.
        count: echoes to store before stopping; None records until `stopped`.
        commit_interval: longest time an echo waits for its commit [s]; a kill loses at most this much.
        batch_size: echoes and pieces from which on a commit is made at once.
        stall_time: silence after which the port is closed and opened again [s]; 0 waits for ever.
        stopped: called between reads; True ends the recording.
        report: called with the status after each commit, when the port is lost or comes back, and once a second.
    """

    def __init__(
        self,
        stream: EchoStream,
        store: EchoStore,
        reconnect: Callable[[], EchoStream],
        *,
        count: int | None = None,
        commit_interval: float = 0.25,
        batch_size: int = 4096,
        stall_time: float = 0.0,
        stopped: Callable[[], bool] = lambda: False,
        report: Callable[[RecordingStatus], None] = lambda status: None,
    ) -> None:
        """Check the arguments; `run` records."""
        if count is not None:
            count = check_count(count, "count", least=0)
            if count < 1:
                raise ValueError(f"count = {count}: give 1 or more, or leave it out to record until interrupted")
        for name, seconds in (("commit interval", commit_interval), ("stall time", stall_time)):
            if not is_number(seconds) or not seconds >= 0.0:
                raise ValueError(f"{name} = {seconds!r} s: give 0 or more")
        batch_size = check_count(batch_size, "batch_size")
        self._stream, self._store, self._reconnect, self._count = stream, store, reconnect, count
        self._commit_interval, self._batch_size, self._stall_time = commit_interval, batch_size, stall_time
        self._stopped, self._report = stopped, report
        self._status = RecordingStatus()
        self._batch_count, self._batch_since = 0, 0.0
        self._damaged_count = 0
        self._last_echo: Waveform | None = None
        self._reported_at = self._began_at = 0.0

    def run(self) -> RecordingStatus:
        """Record and return the final status; wait for a lost port to come back.

        Raises:
            StoreError: the store cannot be written; the port is closed, and committed echoes are safe.
        """
        stream: EchoStream | None = self._stream
        self._reported_at = self._began_at = time.monotonic()
        while stream is not None:
            try:
                lost = self._record_from(stream)
            finally:
                last_pieces = stream.close()
            self._take_all(last_pieces)
            if lost is None:
                break
            self._take_all((piece, time.time_ns()) for piece in stream.cut_off(f"cut off: {lost}"))
            self._commit(lost)
            stream = self._wait_for_port()
        self._commit(self._status.port_state)
        return self._status

    def _record_from(self, stream: EchoStream) -> str | None:
        """Record until the count or a stop; return None, or the reason if the port was lost."""
        while not (self._done() or self._stopped()):
            try:
                pieces = stream.poll()
            except PORT_ERRORS as error:
                return f"the port was lost ({' '.join(str(error).split())})"
            self._take_all(pieces)
            now = time.monotonic()
            if self._stall_time and now - stream.heard_at > self._stall_time:
                return f"nothing came for {self._stall_time:g} s"
            if self._batch_count and (stream.waits_long or now - self._batch_since >= self._commit_interval):
                self._commit(self._state_of(stream))
            elif not self._batch_count and now - self._reported_at >= _REPORT_INTERVAL:
                self._report_state(self._state_of(stream))
        return None

    def _state_of(self, stream: EchoStream) -> str:
        """Return the state of an open port."""
        now = time.monotonic()
        if now - stream.heard_at >= 1.0:
            return "silent"
        is_waiting = stream.waits_long or now - self._began_at < _NO_FRAME_TIME  # an oscilloscope waits for a trigger
        has_frames = self._status.stored_count or self._store.pending_count or self._store.duplicate_count
        return "open" if is_waiting or has_frames else NO_GOOD_FRAME

    def _take_all(self, pieces: Iterable[tuple[Piece, int]]) -> None:
        """Add pieces to the batch."""
        for piece, host_time in pieces:
            if self._done():
                break
            if not self._batch_count:
                self._batch_since = time.monotonic()
            self._batch_count += 1
            if isinstance(piece, DamagedPiece):
                self._store.add_damaged(piece, host_time)
                self._damaged_count += 1
            elif self._store.add(piece, host_time):
                self._last_echo = piece
        if self._batch_count >= self._batch_size:
            self._commit(self._status.port_state)

    def _commit(self, port_state: str) -> None:
        status, store = self._status, self._store
        stored = store.pending_count + store.duplicate_count
        store.commit()
        stored -= store.duplicate_count  # the commit may find duplicates that another recorder has stored meanwhile
        self._batch_count = 0
        self._status = replace(
            status,
            stored_count=status.stored_count + stored,
            duplicate_count=store.duplicate_count,
            damaged_count=self._damaged_count,
            missing_count=store.missing_count,
            last_sequence=store.last_sequence if stored else status.last_sequence,
            last_peak=self._last_echo.peak if stored and self._last_echo else status.last_peak,
        )
        self._report_state(port_state)

    def _report_state(self, port_state: str) -> None:
        self._status = replace(self._status, port_state=port_state)
        self._reported_at = time.monotonic()
        self._report(self._status)

    def _done(self) -> bool:
        return self._count is not None and self._status.stored_count + self._store.pending_count >= self._count

    def _wait_for_port(self) -> EchoStream | None:
        """Wait for the port and return it once it can be opened; None if the recording was stopped meanwhile."""
        wait, lost = 0.1, self._status.port_state  # [s]; the wait doubles up to 5 s
        while not self._stopped():
            # Wait before the first attempt: a port that opens and fails at once must not be reopened without a pause.
            until = time.monotonic() + wait
            while time.monotonic() < until and not self._stopped():
                time.sleep(min(0.1, wait))
                if time.monotonic() - self._reported_at >= _REPORT_INTERVAL:
                    self._report_state(lost)
            wait = min(2.0 * wait, 5.0)
            with contextlib.suppress(PortError):
                stream = self._reconnect()
                self._status = replace(self._status, reconnect_count=self._status.reconnect_count + 1)
                self._report_state("open")
                return stream
        return None
