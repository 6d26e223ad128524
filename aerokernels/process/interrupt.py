"""Signals as an exception that never interrupts an import or a file being written, or as a flag; and closed streams.

Python runs a signal handler between any two of its steps. An exception raised by the handler within an import can leave
Python's import lock taken, so that other threads wait for ever. Raised in code that `exec` got as text, it makes Python
end by SIGINT whatever exit status was requested. Libraries whose C code calls Python may crash if an exception passes
through them, with results half-written. There a signal waits.
"""

import atexit
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

# Signals by which a user, a batch system or a closing terminal requests a command to end.
STOPPING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))

WAITED_FOR = ("<frozen importlib", *(f"{os.sep}{name}{os.sep}" for name in ("h5py", "h5netcdf", "matplotlib")))


def heeded(number: int) -> bool:
    """Return whether a signal counts: under `nohup` a closing terminal's signal is ignored from the start.

    An interrupt always counts: scripts start background commands with interrupts ignored.
    """
    return number in (signal.SIGINT, signal.SIGTERM) or signal.getsignal(number) is not signal.SIG_IGN


def raise_interrupts() -> list[int]:
    """Make the signals that count raise KeyboardInterrupt in the caller from now on; return a list of those raised."""
    raised: list[int] = []
    waiting: list[int] = []
    base = sys._getframe(1)
    can_wait = hasattr(signal, "setitimer")

    def stop(number: int, frame: FrameType | None) -> None:
        if can_wait and _would_harm(frame, base):
            waiting[:] = [number]
            signal.setitimer(signal.ITIMER_REAL, 0.02)
            return
        raised.append(number)
        raise KeyboardInterrupt

    def again(_: int, frame: FrameType | None) -> None:
        if waiting:
            stop(waiting.pop(), frame)

    for number in filter(heeded, STOPPING):
        signal.signal(number, stop)
    if can_wait:
        signal.signal(signal.SIGALRM, again)
        atexit.register(signal.setitimer, signal.ITIMER_REAL, 0.0)  # at its exit Python forgets its handlers
    return raised


def _would_harm(frame: FrameType | None, base: FrameType) -> bool:
    """Return whether an exception in this frame would interrupt protected code above `base`."""
    while frame is not None and frame is not base:
        code = frame.f_code
        text = (code.co_name, code.co_filename) == ("<module>", "<string>")  # code that `exec` got as text
        if text or any(name in code.co_filename for name in WAITED_FOR):
            return True
        frame = frame.f_back
    return False


@contextmanager
def interrupt_flag() -> Iterator[threading.Event]:
    """Yield an event that Ctrl-C, SIGTERM and a closing terminal set; restore their former handlers afterwards.

    A block that ends with a KeyboardInterrupt, because it had nothing to finish, hands the signal itself on to the
    former handler: the exit status depends on its number.
    """
    flag = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield flag  # only the main thread may handle signals; elsewhere the caller sets the flag
        return
    seen: list[int] = []

    def note(number: int, _: FrameType | None) -> None:
        seen.append(number)
        flag.set()

    former = {number: signal.signal(number, note) for number in STOPPING if heeded(number)}
    is_handed_on = False
    try:
        yield flag
    except KeyboardInterrupt:
        is_handed_on = bool(seen)
        raise
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
        if is_handed_on:
            signal.raise_signal(seen[0])


def open_closed_streams() -> None:
    """Open the null device for each standard stream that the process was started without, for C and for Python.

    The next file to be opened would take the number of a closed stream, and what a library in C prints would be written
    into that file.
    """
    streams = ("stdin", "r"), ("stdout", "w"), ("stderr", "w")  # of the file descriptors 0, 1 and 2
    for number in range(len(streams)):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # gets the lowest free number, which is this one
    for number, (name, mode) in enumerate(streams):
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, encoding="utf-8", errors="replace", closefd=False))
