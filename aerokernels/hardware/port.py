"""Open a serial port or a pyserial URL exclusively, and read the bytes that have arrived."""

import errno
import queue
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from aerokernels.inputs.checks import check_count
from aerokernels.inputs.kinds import is_number

if TYPE_CHECKING:
    import serial

# Exceptions raised by a port that was lost: SerialException is an OSError, termios.error is not.
try:
    import termios
except ImportError:  # Windows has no such module, and no such error
    PORT_ERRORS: tuple[type[Exception], ...] = (OSError,)
else:
    PORT_ERRORS = (OSError, termios.error)

_OPEN_ERRORS: tuple[type[Exception], ...] = (*PORT_ERRORS, ValueError)  # a bad URL is a ValueError
FLOW_CONTROLS = ("none", "rtscts", "dsrdtr")
_LONGEST_READ = 65536
_SOCKET_WAIT = 0.1  # [s]


class PortError(ValueError):
    """A port cannot be opened; the message names the port and the remedy."""


def open_port(port: str, *, baud: int = 115200, timeout: float = 0.1, flow: str = "none") -> "serial.SerialBase":
    """Open `port` exclusively: a second process that opens it gets an error.

    Args:
        port: device ("/dev/ttyUSB0", "/dev/serial/by-id/...", "COM3") or pyserial URL ("socket://host:port",
            "rfc2217://host:port", "loop://").
        baud: line rate [bit/s].
        timeout: longest time that a read waits for its first byte [s]; a write may take ten times as long.
        flow: hardware flow control, one of `FLOW_CONTROLS`.

    Raises:
        PortError: the port does not exist, is in use, is not a serial port, or permission is missing.
        ValueError: an invalid line rate, timeout or flow control.
        TypeError: a port that is no text.
    """
    import serial

    if not isinstance(port, str):
        raise TypeError(f"port must be a text such as /dev/ttyUSB0, got {port!r}")
    baud = check_count(baud, "the line rate", most=2**31 - 1)  # the drivers' field has 31 bits
    if not is_number(timeout) or not 0.0 <= timeout < threading.TIMEOUT_MAX:
        raise ValueError(f"timeout = {timeout!r}: give seconds, 0 or more")
    if flow not in FLOW_CONTROLS:
        why = ", which takes bytes out of binary data" if "xon" in str(flow).lower() else ""
        raise ValueError(f"flow control {flow!r}{why}: give one of {', '.join(FLOW_CONTROLS)}")
    try:
        opened = serial.serial_for_url(
            port,
            baudrate=baud,
            timeout=timeout,
            write_timeout=None if port.startswith("rfc2217:") else 10.0 * timeout,  # pyserial has none there
            exclusive=True,
            rtscts=flow == "rtscts",
            dsrdtr=flow == "dsrdtr",
        )
    except _OPEN_ERRORS as error:
        raise PortError(f"port {port!r}: {_remedy(port, error)}") from error
    if _is_socket(opened):
        opened.timeout = 0  # a read returns the available bytes at once, see `_read_socket`
    return opened


def read_available(port: "serial.SerialBase") -> bytes:
    """Return the bytes that have arrived; wait up to the port's timeout for the first one, empty when none came."""
    if _is_socket(port):
        return _read_socket(port)
    first = port.read(max(1, min(port.in_waiting, _LONGEST_READ)))
    with suppress(*PORT_ERRORS):  # the next call raises the same error
        if first and (waiting := min(port.in_waiting, _LONGEST_READ)):  # by now more have usually arrived
            return first + port.read(waiting)
    return first


def _read_socket(port: "serial.SerialBase") -> bytes:
    """Read from a socket; a longer read by pyserial would drop the bytes that came before the peer closed."""
    until = time.monotonic() + _SOCKET_WAIT
    while not port.in_waiting:  # for a socket this is 0 or 1, not a count
        if time.monotonic() > until:
            return b""
        time.sleep(_SOCKET_WAIT / 20.0)
    return port.read(_LONGEST_READ)


def _is_socket(port: "serial.SerialBase") -> bool:
    return str(port.port).startswith("socket:")


def close_port(port: "serial.SerialBase") -> None:
    """Close a port in any state, without raising."""
    with suppress(*PORT_ERRORS):  # a lost device may fail to close
        port.close()


def _remedy(port: str, error: Exception) -> str:
    code = getattr(error, "errno", None)
    if code in (errno.EAGAIN, errno.EBUSY):
        return "in use by another process: stop that one, or record from another port"
    if code in (errno.EACCES, errno.EPERM):
        return "permission denied: add your user to the group that owns the device (often 'dialout') and log in again"
    if code in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        return f"no such port: plug the board in, or choose one of {_known_ports()}"
    refused = code is None and isinstance(error.__context__, PORT_ERRORS)  # pyserial could not configure it
    if refused or code in (errno.ENOTTY, errno.EISDIR, errno.ENOTDIR, errno.ELOOP, errno.ENAMETOOLONG):
        return "not a serial port: give a device such as /dev/ttyUSB0 or a pyserial URL"
    if "://" in port:
        return f"{error}: check the pyserial URL, for example socket://192.168.0.7:4000"
    return str(error)


def _known_ports() -> str:
    from serial.tools import list_ports

    names = sorted({entry.device for entry in list_ports.comports()})
    by_id = Path("/dev/serial/by-id")
    if by_id.is_dir():
        names = sorted(str(path) for path in by_id.iterdir()) + names
    return ", ".join(names) or "(none is connected now; `aerokernels board --link PATH` makes a simulated one)"


class PortReader:
    """Reads an open port ahead of its user, who closes it after `stop`."""

    def __init__(self, port: "serial.SerialBase") -> None:
        """Start reading."""
        self._port = port
        # Most chunks that wait in memory; beyond that reading pauses, and the port's own flow control takes over.
        self._chunks: queue.Queue[tuple[bytes, int]] = queue.Queue(1024)
        self._stopping = threading.Event()
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._read, name="port reader", daemon=True)
        self._thread.start()

    def next(self, timeout: float = 0.1) -> tuple[bytes, int] | None:
        """Return the next bytes and their arrival time [ns since 1970]; None when none came within `timeout` [s].

        The error of a port that was lost is raised after all bytes that came before were returned.
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
            item = None
            while not self._stopping.is_set():
                if item is None and (chunk := read_available(self._port)):
                    item = chunk, time.time_ns()
                if item is not None:
                    with suppress(queue.Full):
                        self._chunks.put(item, timeout=0.1)
                        item = None
        except Exception as error:  # raised again in the user's thread by `next`
            self._failure = error
