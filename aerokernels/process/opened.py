"""Hold what this process keeps open between calls; the package's only global state.

Opening a device, building a kernel and starting a child process each take much longer than using them, so each is done
once per process. Anything that belongs to a field, a result or a prepared object is stored on that object, not here;
what fields share is found through weak references, which keep nothing.
"""

import os
import threading
from collections.abc import Callable, Hashable
from typing import Any


class Locked:
    """A base of objects that live as long as the process: gives them a lock, and another one in each forked child.

    A fork copies a lock that another thread holds, but not that thread: the child would wait for ever (forks.py).
    """

    def __init__(self) -> None:
        """Start without a lock."""
        self._locks: dict[int, Any] = {}

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
        try:
            return self._held[key]
        except KeyError:
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
