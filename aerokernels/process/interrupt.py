"""Interrupts where they do no harm: as an exception that never breaks into an import, or as a flag.

A handler runs between any two steps of Python. An exception that it raises within an import can leave Python's import
lock taken, for which other threads then wait for ever; raised in a callback, it is printed and lost; raised in code
that `exec` was given as text, it makes Python end by SIGINT whatever status it is told to leave with. Libraries whose C
code calls Python back may crash when they are left by it.
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
"""Signals by which a user, a batch system or a terminal that closes asks a command to end."""

RUN_TEXT = "<module>", "<string>"  # name and file of code that `exec` was given as text
# Libraries that are left to finish: a crash while results are written leaves them half-written.
FINISHING = tuple(f"{os.sep}{name}{os.sep}" for name in ("h5py", "h5netcdf", "matplotlib"))
AGAIN = 0.02  # seconds after which a signal that came at a bad moment is looked at again


def heeded(number: int) -> bool:
    """Whether a signal counts: `nohup` has that of a terminal that closes ignored from the start.

    An interrupt always counts. Scripts have it ignored in what they start in the background, which would leave `kill`
    with SIGTERM alone to end a recording there.
    """
    return number in (signal.SIGINT, signal.SIGTERM) or signal.getsignal(number) is not signal.SIG_IGN


def raise_interrupts() -> list[int]:
    """Have the signals that count raise KeyboardInterrupt in the caller, for the rest of the process.

    Returns:
        A list to which the number of each signal is added as it is raised.
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
        atexit.register(signal.setitimer, signal.ITIMER_REAL, 0.0)  # when Python leaves it forgets its handlers
    sys.unraisablehook = lost
    return raised


def _would_harm(frame: FrameType | None, base: FrameType) -> bool:
    """Whether an exception in this frame would break into what it must not break into, above `base`."""
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
    """An event that Ctrl-C, SIGTERM and a terminal that closes set; their former handlers come back afterwards."""
    flag = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield flag  # only the main thread may take signals; elsewhere the caller sets the flag
        return
    former = {number: signal.signal(number, lambda *_: flag.set()) for number in STOPPING if heeded(number)}
    try:
        yield flag
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
