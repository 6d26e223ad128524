"""A thread that empties a port while the rest of the recorder decodes or waits for the disk.

A serial driver buffers a few kilobytes. At 2 MB/s that is full within milliseconds, and flushing a disk takes longer.
"""

import queue
import threading
import time
from typing import TYPE_CHECKING

from aerokernels.hardware.port import read_available

if TYPE_CHECKING:
    import serial

# Most chunks that wait in memory; beyond that reading pauses, and the port's own flow control takes over.
_GREATEST_BACKLOG = 1024


class PortReader:
    """Reads a port ahead of its user.

    Args:
        port: the open port; only this reader reads from it, and the user closes it after `stop`.
    """

    def __init__(self, port: "serial.SerialBase") -> None:
        """Start reading."""
        self._port = port
        self._chunks: queue.Queue[tuple[bytes, int]] = queue.Queue(_GREATEST_BACKLOG)
        self._stopping = threading.Event()
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._read, name="port reader", daemon=True)
        self._thread.start()

    def next(self, timeout: float = 0.1) -> tuple[bytes, int] | None:
        """Return the next bytes and their arrival time [ns since 1970]; None when none came within `timeout` [s].

        Raises:
            OSError, termios.error: the port was lost; raised after all bytes that came before were returned.
        """
        try:
            return self._chunks.get(timeout=timeout)
        except queue.Empty:
            if self._failure is not None and self._chunks.empty():
                raise self._failure from None
            return None

    def stop(self) -> None:
        """Stop reading; `next` still returns the bytes that were read."""
        self._stopping.set()
        self._thread.join()

    def _read(self) -> None:
        try:
            while not self._stopping.is_set():
                chunk = read_available(self._port)
                if chunk:
                    self._put((chunk, time.time_ns()))
        except Exception as error:  # raised again in the user's thread by `next`
            self._failure = error

    def _put(self, item: tuple[bytes, int]) -> None:
        while True:
            try:
                return self._chunks.put(item, timeout=0.1)
            except queue.Full:
                if self._stopping.is_set():
                    return None  # never acknowledged
