"""Copies between the host and a GPU through pinned memory, which the GPU accesses directly at full speed.

Pinning memory takes longer than copying through it: pinned memory is cached for the next copy, within limits, and so is
the memory of a result's arrays once the result is deleted. Results may be copied chunk by chunk while later ones are
computed, on a stream of their own; rays copied from the host at the same time use the other direction of the bus.
"""

import os
import threading
import weakref
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any

import numpy as np

from ..process.machine import core_count, host_memory
from ..process.opened import OPENED

# Memory is pinned in units of so many bytes; smaller arrays are not worth it.
LEAST = 1 << 20
# Share of the host's memory that may be pinned, and most unused pinned memory that is cached [bytes].
PINNED_SHARE, KEPT = 0.25, 4 << 30
# Cached memory is reused for an array that fills at least this share of it.
FILLED = 0.75


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
            size = -(-size // LEAST) * LEAST  # whole units
            fitting = [each for each in self._free if FILLED * each.size <= size <= each.size]
            if fitting:
                best = min(fitting, key=lambda each: each.size)
                self._free = [each for each in self._free if each is not best]
                self._taken.add(id(best))
                return best
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

    def arrived(self) -> np.ndarray:
        """Wait for the copies and return the array."""
        self.wait()
        return np.asarray(self)

    def __del__(self) -> None:
        """Return the memory to the cache."""
        with suppress(Exception):  # the process may be ending
            self.wait()
            self.memory.give_back(self.buffer)


# Rays copied to a GPU together, threads that copy them to pinned memory, and chunks on their way at once.
ROWS, THREADS, SLOTS = 1 << 19, 12, 8  # speed only
# Bytes that a thread copies at a time: larger pieces pass through a processor's caches at half the rate.
PIECE = 4 << 20  # speed only


def pinned_memory() -> PinnedMemory:
    """Return this process's cache of pinned memory."""
    memory: PinnedMemory = OPENED.once(("pinned memory", os.getpid()), lambda: PinnedMemory(_pinned))
    return memory


def _pinned(size: int) -> Any:
    import warp

    return warp.empty(size, dtype=warp.uint8, device="cpu", pinned=True)


def to_host(buffer: Any) -> np.ndarray:
    """Return a warp.array as a NumPy array: of the CPU device itself, of a GPU a copy (through pinned memory if large).

    Waits for everything launched before. Warp's own `numpy()` makes another stream the device's current one meanwhile:
    threads that call it at the same time leave the wrong one behind, and what others launch is not waited for.

    Args:
        buffer: Array of one dimension, of numbers or vectors.
    """
    import warp

    if not buffer.device.is_cuda:
        return np.asarray(buffer)
    if not len(buffer):
        return np.empty(*layout_of(buffer))
    size = buffer.size * warp.types.type_size_in_bytes(buffer.dtype)
    taken = None if size < LEAST else pinned_memory().take(size)
    if taken is None:
        array = np.empty(*layout_of(buffer))
        there = warp.array(ptr=array.ctypes.data, dtype=buffer.dtype, shape=(len(buffer),), device="cpu")
    else:
        array = np.asarray(Lent(pinned_memory(), taken, *layout_of(buffer)))
        there = as_kind(taken, buffer.dtype, len(buffer))
    warp.copy(there, buffer.contiguous())
    warp.synchronize_stream(buffer.device)
    return array


def layout_of(buffer: Any) -> tuple[tuple[int, ...], np.dtype]:
    """Return shape and type in NumPy's terms of a one-dimensional warp.array of numbers or vectors."""
    import warp

    kind, width = buffer.dtype, int(getattr(buffer.dtype, "_length_", 1))
    number = np.dtype(warp.dtype_to_numpy(getattr(kind, "_wp_scalar_type_", kind)))
    return ((len(buffer), width) if width > 1 else (len(buffer),)), number


def bring(arrays: list[np.ndarray], buffers: list[Any], rows: int = ROWS) -> Iterator[slice]:
    """Copy rays to a GPU, chunk by chunk through pinned memory; yield each chunk as soon as kernels may use it.

    Kernels launched on the device's stream after a chunk was yielded find it there, while the next ones are being
    copied: as many chunks as there are slots of pinned memory, each by several threads.

    Args:
        arrays: Arrays with the same number of rows, C-contiguous.
        buffers: A warp.array of the same length for each, on one device.
        rows: Rows per chunk.
    """
    import warp

    from .launching import lent_stream

    device, count = buffers[0].device, len(arrays[0])
    chunks = [slice(first, min(first + rows, count)) for first in range(0, count, rows)]
    slots = _slots(arrays, min(rows, count), min(SLOTS, len(chunks))) if device.is_cuda else []
    if not slots:
        for chunk in chunks:
            for array, buffer in zip(arrays, buffers, strict=True):
                some = warp.array(array[chunk], dtype=buffer.dtype, device="cpu")
                warp.copy(buffer, some, dest_offset=chunk.start)
            yield chunk
        return
    events: list[Any] = []
    jobs: list[list[Any]] = []
    try:
        with ThreadPoolExecutor(min(THREADS, core_count())) as pool:
            stream = lent_stream(pool, device)
            stream.wait_stream(device.stream)  # the buffers were allocated in the order of the device's stream

            def stage_next() -> None:
                chunk, slot = chunks[len(jobs)], slots[len(jobs) % len(slots)]
                jobs.append([pool.submit(np.copyto, *pair) for pair in _pieces(arrays, slot, chunk)])

            for _ in slots:
                stage_next()
            for number, chunk in enumerate(chunks):
                for job in jobs[number]:
                    job.result()
                for taken, buffer in zip(slots[number % len(slots)], buffers, strict=True):
                    view = as_kind(taken, buffer.dtype, chunk.stop - chunk.start)
                    warp.copy(buffer, view, dest_offset=chunk.start, count=len(view), stream=stream)
                events.append(stream.record_event())
                device.stream.wait_event(events[-1])
                yield chunk
                if number and len(jobs) < len(chunks):  # the previous chunk's slot has been read, or is about to be
                    warp.synchronize_event(events[number - 1])
                    stage_next()
    finally:
        for event in events[-len(slots) :]:
            warp.synchronize_event(event)
        _give_back(slots)


def _slots(arrays: list[np.ndarray], rows: int, count: int) -> list[list[Any]]:
    """Return pinned memory for so many rows of each array, up to `count` times; empty if there is not enough."""
    slots: list[list[Any]] = []
    for _ in range(count):
        slot = [pinned_memory().take(array[:1].nbytes * rows) for array in arrays]
        if any(taken is None for taken in slot):
            _give_back([slot])
            break
        slots.append(slot)
    if len(slots) > 1 or count == 1:
        return slots
    _give_back(slots)
    return []


def _give_back(slots: list[list[Any]]) -> None:
    """Return the memory of slots to the cache."""
    for taken in (taken for slot in slots for taken in slot if taken is not None):
        pinned_memory().give_back(taken)


def _pieces(arrays: list[np.ndarray], slot: list[Any], chunk: slice) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Return the pinned memory and the numbers of each piece of a chunk, array by array."""
    for array, taken in zip(arrays, slot, strict=True):
        some = array[chunk].reshape(-1)
        there = np.asarray(taken)[: some.nbytes].view(some.dtype)
        size = max(1, PIECE // some.itemsize)
        for first in range(0, len(some), size):
            yield there[first : first + size], some[first : first + size]


def as_kind(taken: Any, kind: Any, count: int) -> Any:
    """Return the first bytes of pinned memory as `count` elements of a type."""
    import warp

    return warp.array(ptr=taken.ptr, dtype=kind, shape=(count,), device="cpu", pinned=True)


class Fetching:
    """Copies arrays to the host, rows by rows in the order in which they are finished."""

    def __init__(self, buffers: dict[str, Any], memory: dict[str, Lent]):
        """Prepare for these arrays of a GPU, by name, and the memory pinned for each."""
        import warp

        from .launching import lent_stream

        self.buffers, self.memory = buffers, memory
        self.device = next(iter(buffers.values())).device
        self.stream, self.event = lent_stream(self, self.device), warp.Event(self.device)
        self.there = {name: as_kind(memory[name].buffer, each.dtype, len(each)) for name, each in buffers.items()}

    @classmethod
    def of(cls, buffers: dict[str, Any]) -> "Fetching | None":
        """Return the Fetching of arrays of a GPU, by name; None if so much memory cannot be pinned."""
        import warp

        memory = {}
        for name, buffer in buffers.items():
            taken = pinned_memory().take(buffer.size * warp.types.type_size_in_bytes(buffer.dtype))
            if taken is None:
                return None
            memory[name] = Lent(pinned_memory(), taken, *layout_of(buffer))
        return cls(buffers, memory)

    def rows(self, rows: slice) -> None:
        """Start to copy rows, in the state after everything launched before."""
        import warp

        self.stream.wait_stream(self.device.stream)
        first, count = rows.start, rows.stop - rows.start
        for name, buffer in self.buffers.items():
            there = self.there[name]
            warp.copy(there, buffer, dest_offset=first, src_offset=first, count=count, stream=self.stream)
        self.stream.record_event(self.event)
        for name, lent in self.memory.items():  # keep both ends of a copy alive until it has ended
            lent.event, lent.source = self.event, self.buffers[name]

    def coming(self) -> dict[str, Lent]:
        """Return the arrays by name; copies of all rows must have been started."""
        return self.memory
