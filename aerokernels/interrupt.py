"""Interrupts as a flag, so that a loop ends between two reads and never inside a transaction."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

STOPPING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals by which a user, a batch system or a terminal that closes asks a command to end."""


def heeded(number: int) -> bool:
    """Whether a signal counts: `nohup` has that of a terminal that closes ignored from the start.

    An interrupt always counts. Scripts have it ignored in what they start in the background, which would leave `kill`
    with SIGTERM alone to end a recording there.
    """
    return number in (signal.SIGINT, signal.SIGTERM) or signal.getsignal(number) is not signal.SIG_IGN


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
