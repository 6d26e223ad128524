"""Hold what this process keeps open between calls, the package's only global state, and keep it sound when it forks.

Opening a device, building a kernel and starting a child process each take much longer than using them, so each is done
once per process. Anything that belongs to a field, a result or a prepared object is stored on that object, not here;
what fields share is found through weak references, which keep nothing.

A fork copies a lock that another thread holds, but not that thread, so that the child would wait for it for ever. A
fork therefore waits until other threads have opened and imported what they are about to; and a child has locks of its
own. A child started by `subprocess` uses nothing that is copied, so that it need not wait.
"""

import os
import sys
import threading
import time
import weakref
from collections.abc import Callable, Hashable
from types import FrameType
from typing import Any, ClassVar

PATIENCE = 60.0  # [s]; a thread that takes longer may itself wait for the one that forks


class Locked:
    """A base of objects that live as long as the process: gives them a lock, and another one in each forked child."""

    every: ClassVar["weakref.WeakSet[Locked]"] = weakref.WeakSet()

    def __init__(self) -> None:
        """Start without a lock."""
        self._locks: dict[int, Any] = {}
        Locked.every.add(self)

    @property
    def lock(self) -> Any:
        """The lock of this process, reentrant: what is made may be made of parts that are kept too."""
        own = os.getpid()
        return self._locks.get(own) or self._locks.setdefault(own, threading.RLock())


class Opened(Locked):
    """Objects opened once per key, until they are taken out or the process ends; thread-safe.

    A forked child inherits them; the keys of objects that do not survive a fork contain the process's id.
    """

    def __init__(self) -> None:
        """Start with nothing open."""
        super().__init__()
        self._held: dict[Hashable, Any] = {}

    def once(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return the object under this key, made by `make` at the first call."""
        with self.lock:
            if key not in self._held:
                self._held[key] = make()
            return self._held[key]

    def get(self, key: Hashable) -> Any:
        """Return the object under a key; None if there is none."""
        return self._held.get(key)

    def held(self, kind: str) -> dict[tuple, Any]:
        """Return all objects whose keys are tuples that begin with `kind`, by key."""
        with self.lock:
            return {key: thing for key, thing in self._held.items() if isinstance(key, tuple) and key[0] == kind}

    def take_out(self, key: Hashable) -> Any:
        """Remove and return the object under a key; None if there is none."""
        with self.lock:
            return self._held.pop(key, None)


OPENED = Opened()


def make_forks_safe() -> None:
    """Do so for this process, from the first call on: a program that only imports the package is left alone."""
    OPENED.once("safe forks", _register)


def _register() -> bool:
    import logging  # noqa: F401  # its own functions, registered before ours, run after them: they lock what imports need

    if hasattr(os, "register_at_fork"):  # not on Windows, which has no fork
        taken: list[Any] = []

        def give_back() -> None:
            while taken:
                taken.pop().release()

        os.register_at_fork(before=lambda: _wait(taken), after_in_parent=give_back)
    return True


def _wait(taken: list[Any]) -> None:
    """Wait until no other thread imports anything, and take all locks; none if this thread has one already."""
    own, end = threading.get_ident(), time.monotonic() + PATIENCE
    locks = [each.lock for each in list(Locked.every)]
    if any(lock._is_owned() for lock in locks):  # the others may wait for this thread
        return
    while time.monotonic() < end and any(
        _imports(frame) for thread, frame in sys._current_frames().items() if thread != own
    ):
        time.sleep(0.01)
    taken += [lock for lock in locks if lock.acquire(timeout=max(0.0, end - time.monotonic()))]


def _imports(frame: FrameType | None) -> bool:
    while frame is not None and frame.f_code.co_filename != "<frozen importlib._bootstrap>":
        frame = frame.f_back
    return frame is not None
