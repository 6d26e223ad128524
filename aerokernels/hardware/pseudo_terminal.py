"""A pseudo-terminal under a chosen name that simulates a serial port."""

import os
import re
import select
import time
from collections.abc import Callable
from pathlib import Path

from aerokernels.inputs.checks import check_path


def never() -> bool:
    """Never stop."""
    return False


class PseudoTerminal:
    """The board's end of a pseudo-terminal whose other end is reached through a symbolic link.

    Args:
        link: path for the link; a link left over from an earlier terminal is replaced.

    Raises:
        ValueError: `link` is a file or a link to something other than a terminal, its folder does not exist or cannot
            hold links, or this system has no pseudo-terminals.
    """

    def __init__(self, link: str | Path) -> None:
        """Make the terminal and the link."""
        self.link = check_path(link, "link")
        if self.link.exists() and not self.link.is_symlink():
            raise ValueError(f"link {self.link} is a file or a folder: give a path that is free")
        if not self.link.parent.is_dir():
            raise ValueError(f"link {self.link}: folder {self.link.parent} does not exist; make it first")
        held = os.readlink(self.link) if self.link.is_symlink() else "/dev/pts/0"
        if re.sub(r"\d", "", held) not in ("/dev/pts/", "/dev/ttys"):  # of Linux, of macOS
            raise ValueError(f"link {self.link} leads to {held}, which is no terminal: give a path that is free")
        if not hasattr(os, "openpty"):
            raise ValueError("this system has no pseudo-terminals: run the simulated board on Linux or macOS")
        self._master = -1
        self.open()

    def open(self) -> None:
        """Plug in: make a new terminal under the same link."""
        import tty

        self.close()
        self._master, slave = os.openpty()
        tty.setraw(slave)  # bytes pass unchanged, nothing is echoed
        self.name = os.ttyname(slave)
        # Closed here, so that the hang-up condition shows whether a reader has the other end open.
        os.close(slave)
        os.set_blocking(self._master, False)
        self._poll = select.poll()
        self._poll.register(self._master, select.POLLOUT)
        try:
            self.link.unlink(missing_ok=True)
            self.link.symlink_to(self.name)
        except OSError as fault:
            self.close()
            raise ValueError(
                f"link {self.link}: none can be made there ({fault.strerror}); give another path"
            ) from None

    def has_reader(self) -> bool:
        """Whether someone has the port open."""
        return not any(event & select.POLLHUP for _, event in self._poll.poll(0))

    def read(self, timeout: float = 0.1) -> bytes:
        """Return the bytes that the reader sent; wait up to `timeout` [s], empty when none came."""
        readable, _, _ = select.select([self._master], [], [], timeout)
        if not readable:
            return b""
        try:
            return os.read(self._master, 65536)
        except BlockingIOError:
            return b""
        except OSError:  # no reader has the port open
            time.sleep(min(timeout, 0.02))
            return b""

    def write(self, data: bytes, stopped: Callable[[], bool] = never) -> bool:
        """Write all of `data`, waiting for a slow reader; False when the reader left or `stopped()` was True first."""
        left = memoryview(data)
        while left:
            if stopped() or not self.has_reader():
                return False
            try:
                left = left[os.write(self._master, left) :]
            except BlockingIOError:
                self._poll.poll(50)
        return True

    def drain(self, stopped: Callable[[], bool] = never) -> None:
        """Wait until the reader has read everything or has left: closing the terminal would discard the rest."""
        import fcntl
        import struct
        import termios

        try:
            slave = os.open(self.name, os.O_RDWR | os.O_NOCTTY)
        except OSError:
            return
        try:
            before, unread = -1, 1
            while unread and unread != before and not stopped():
                before = unread
                time.sleep(0.5)  # a reader that reads nothing in this time has stopped reading
                (unread,) = struct.unpack("i", fcntl.ioctl(slave, termios.FIONREAD, b"\0\0\0\0"))
        finally:
            os.close(slave)

    def close(self) -> None:
        """Unplug: remove the link; reads at the reader's end fail from then on."""
        if self._master < 0:
            return
        os.close(self._master)
        self._master = -1
        if self.link.is_symlink() and os.readlink(self.link) == self.name:
            self.link.unlink()

    def __enter__(self) -> "PseudoTerminal":
        """Use as a context, at whose end the terminal is unplugged."""
        return self

    def __exit__(self, *_: object) -> None:
        """Unplug."""
        self.close()
