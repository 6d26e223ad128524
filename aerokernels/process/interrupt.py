"""Turn signals into an exception that never interrupts an import or a file being written, or into a flag.

Python runs a signal handler between any two of its steps. An exception raised by the handler within an import can leave
Python's import lock taken, so that other threads wait for ever. Raised in a callback, the exception is printed and
lost. Raised in code that `exec` got as text, it makes Python end by SIGINT whatever exit status was requested.
Libraries whose C code calls Python may crash if an exception passes through them.
"""

import atexit
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

STOPPING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals by which a user, a batch system or a closing terminal requests a command to end."""

RUN_TEXT = "<module>", "<string>"  # name and file of code that `exec` got as text
# Libraries that may finish first: a crash while they write results leaves the results half-written.
FINISHING = tuple(f"{os.sep}{name}{os.sep}" for name in ("h5py", "h5netcdf", "matplotlib"))
AGAIN = 0.02  # [s] after which a postponed signal is tried again


def heeded(number: int) -> bool:
    """Return whether a signal counts: under `nohup` a closing terminal's signal is ignored from the start.

    An interrupt always counts. Scripts start background commands with interrupts ignored, which would leave only
    SIGTERM to end a recording there.
    """
    return number in (signal.SIGINT, signal.SIGTERM) or signal.getsignal(number) is not signal.SIG_IGN


def raise_interrupts() -> list[int]:
    """Make the signals that count raise KeyboardInterrupt in the caller, for the rest of the process.

    Returns:
        A list to which each signal's number is added when it is raised.
    """
    raised: list[int] = []
    waiting: list[int] = []
    base = sys._getframe(1)
    unraisable = sys.unraisablehook

    def later(number: int) -> None:
        waiting[:] = [number]
        signal.setitimer(signal.ITIMER_REAL, AGAIN)

    def stop(number: int, frame: FrameType | None) -> None:
        if hasattr(signal, "setitimer") and _would_harm(frame, base):
            later(number)
            return
        raised.append(number)
        raise KeyboardInterrupt

    def again(_number: int, frame: FrameType | None) -> None:
        if waiting:
            stop(waiting.pop(), frame)

    def lost(what: Any) -> None:
        if what.exc_type is KeyboardInterrupt and raised and hasattr(signal, "setitimer"):
            later(raised.pop())
        else:
            unraisable(what)

    for number in filter(heeded, STOPPING):
        signal.signal(number, stop)
    if hasattr(signal, "setitimer"):
        signal.signal(signal.SIGALRM, again)
        atexit.register(signal.setitimer, signal.ITIMER_REAL, 0.0)  # at its exit Python forgets its handlers
    sys.unraisablehook = lost
    return raised


def _would_harm(frame: FrameType | None, base: FrameType) -> bool:
    """Return whether an exception in this frame would interrupt protected code above `base`."""
    while frame is not None and frame is not base:
        code = frame.f_code
        if code.co_filename.startswith("<frozen importlib") or (code.co_name, code.co_filename) == RUN_TEXT:
            return True
        if any(library in code.co_filename for library in FINISHING):
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
