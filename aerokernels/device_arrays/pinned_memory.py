"""Cache of pinned memory, which a GPU accesses directly at full speed.

Pinning memory takes longer than copying through it: pinned memory is cached for the next copy, within limits, and so is
the memory of a result's arrays once the result is deleted.
"""

import os
import threading
import weakref
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from ..process.machine import host_memory

# Memory is pinned in units of so many bytes; smaller arrays are not worth it.
LEAST = 1 << 20
# Share of the host's memory that may be pinned, and most unused pinned memory that is cached [bytes].
PINNED_SHARE, KEPT = 0.25, 4 << 30
# Cached memory is reused for an array that fills at least this share of it.
FILLED = 0.75


def _whole(size: int) -> int:
    """A size rounded up to whole units."""
    return -(-size // LEAST) * LEAST


class PinnedMemory:
    """Cache of the memory that one library has pinned in this process; thread-safe."""

    def __init__(self, make: Callable[[int], Any]) -> None:
        """Start empty; `make(size)` pins memory and returns an object with `ptr` and `size`, or raises RuntimeError."""
        self._make = make
        self._free: list[Any] = []
        self._pinned = 0
        self._taken: set[int] = set()  # ids of the buffers that are reused once they are given back
        self._process = os.getpid()
        self._lock = threading.RLock()  # reentrant: the garbage collector may delete an array during `take`
        if hasattr(os, "register_at_fork"):  # not on Windows, which has no fork
            renew = weakref.WeakMethod(self._renew)
            os.register_at_fork(after_in_parent=lambda: (method := renew()) and method())

    def take(self, size: int) -> Any:
        """Return pinned memory of at least so many bytes; None if no more may be pinned."""
        if os.getpid() != self._process:  # a forked child, in which the lock may be held for ever
            return None
        with self._lock:
            found = self.unused(size)
            if found is not None:
                return found
            size = _whole(size)
            if self._pinned + size > PINNED_SHARE * host_memory():
                self._drop(size)
                if self._pinned + size > PINNED_SHARE * host_memory():
                    return None
            try:
                made = self._make(size)
            except RuntimeError:
                return None
            self._pinned += size
            self._taken.add(id(made))
            return made

    def unused(self, size: int) -> Any:
        """Return cached memory of at least so many bytes; None if there is none."""
        if os.getpid() != self._process:
            return None
        size = _whole(size)
        with self._lock:
            fitting = [each for each in self._free if FILLED * each.size <= size <= each.size]
            if not fitting:
                return None
            best = min(fitting, key=lambda each: each.size)
            self._free = [each for each in self._free if each is not best]
            self._taken.add(id(best))
            return best

    def give_back(self, buffer: Any) -> None:
        """Return memory that was taken and that no copy uses."""
        if os.getpid() != self._process:  # a forked child, which can neither use nor free it
            self._free.append(buffer)
            return
        with self._lock:
            if id(buffer) not in self._taken:  # a forked child may still read it
                self._pinned -= buffer.size
                return
            self._taken.remove(id(buffer))
            self._free.append(buffer)
            while sum(each.size for each in self._free) > KEPT:
                self._pinned -= self._free.pop(0).size

    def _renew(self) -> None:
        """Reuse no memory that a forked child has: its arrays would change with those of this process."""
        with self._lock:
            self._taken.clear()
            self._pinned -= sum(each.size for each in self._free)
            self._free = []

    def _drop(self, size: int) -> None:
        """Unpin so many bytes of unused memory, or all of it."""
        while self._free and size > 0:
            gone = self._free.pop(0)
            self._pinned -= gone.size
            size -= gone.size


class Lent:
    """Pinned memory as a NumPy array; returned to its cache when the last array on it is deleted.

    Attributes:
        buffer: The memory.
        event: Event recorded after the pending copies to this memory; None if there are none.
        source: Array that they copy.
    """

    def __init__(self, memory: PinnedMemory, buffer: Any, shape: tuple[int, ...], dtype: np.dtype):
        """Wrap memory that was taken from a cache, for an array of this shape and type."""
        self.memory, self.buffer = memory, buffer
        self.event: Any = None
        self.source: Any = None
        self.__array_interface__ = {"data": (buffer.ptr, False), "shape": shape, "typestr": dtype.str, "version": 3}

    def wait(self) -> None:
        """Wait for the pending copies to this memory."""
        if self.event is not None:
            import warp

            warp.synchronize_event(self.event)
            self.event = self.source = None

    def __del__(self) -> None:
        """Return the memory to the cache."""
        with suppress(Exception):  # the process may be ending
            self.wait()
            self.memory.give_back(self.buffer)
