"""Opening a serial port, or a pyserial URL, for one process alone."""

import errno
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import serial


class PortError(ValueError):
    """A port that cannot be opened; the message names it and the remedy."""


def open_port(port: str, *, baud: int = 115200, timeout: float = 0.1) -> "serial.SerialBase":
    """Open `port` exclusively: a second process asking for it is refused.

    Args:
        port: device ("/dev/ttyUSB0", "/dev/serial/by-id/...", "COM3") or pyserial URL ("socket://host:port", "loop://").
        baud: line rate [bit/s].
        timeout: longest wait of a read for its first byte [s].

    Raises:
        PortError: no such port, no permission, in use, or not a serial port.
    """
    import serial

    if baud <= 0:
        raise ValueError(f"baud = {baud}: give a positive line rate such as 115200")
    try:
        return serial.serial_for_url(port, baudrate=baud, timeout=timeout, exclusive=True)
    except (OSError, ValueError) as error:  # SerialException is an OSError; a bad URL is a ValueError
        raise PortError(f"port {port!r}: {_remedy(port, error)}") from error


def _remedy(port: str, error: Exception) -> str:
    code = getattr(error, "errno", None)
    text = str(error)
    if code in (errno.EAGAIN, errno.EBUSY) or "exclusively lock" in text:
        return "in use by another process: stop that one, or record from another port"
    if code in (errno.EACCES, errno.EPERM):
        return "permission denied: add your user to the group that owns the device (often 'dialout') and log in again"
    if code in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        return f"no such port: plug the board in, or choose one of {_known_ports()}"
    if "configure port" in text or code == errno.ENOTTY:
        return "not a serial port: give a device such as /dev/ttyUSB0 or a pyserial URL"
    if "://" in port:
        return f"{text}: check the pyserial URL, for example socket://192.168.0.7:4000"
    return text


def _known_ports() -> str:
    from serial.tools import list_ports

    names = sorted({entry.device for entry in list_ports.comports()})
    by_id = Path("/dev/serial/by-id")
    if by_id.is_dir():
        names = sorted(str(path) for path in by_id.iterdir()) + names
    return ", ".join(names) or "(none is connected now; `aerokernels board --link PATH` makes a simulated one)"
