"""Copies between host and GPU through pinned memory, which the GPU reads and writes by itself, at full speed.

To pin memory takes longer than to copy over it: what was pinned is kept for the next copy, within limits, and so is
what a result's arrays lie in once the result is gone.
"""

import os
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any

import numpy as np

from ..opened import OPENED

# Arrays of fewer bytes are copied as they are.
LEAST = 1 << 20
# The share of the host's memory that may be pinned, and how much of it is kept though nothing uses it [bytes].
PINNED_SHARE, KEPT = 0.25, 4 << 30
# Memory pinned for one array is taken for a smaller one that fills this share of it.
FILLED = 0.75
# Rays that are brought to a GPU together, and threads that copy them.
ROWS, THREADS = 1 << 20, 12


class PinnedMemory:
    """Pinned memory of this process; thread-safe."""

    def __init__(self) -> None:
        """None yet."""
        self._free: list[Any] = []
        self._pinned = 0
        self._lock = threading.RLock()  # an array may end while another one is taken

    def take(self, size: int) -> Any:
        """A pinned warp.array of at least so many bytes; None where no more may be pinned."""
        import warp

        with self._lock:
            fitting = [each for each in self._free if FILLED * each.size <= size <= each.size]
            if fitting:
                best = min(fitting, key=lambda each: each.size)
                self._free = [each for each in self._free if each is not best]
                return best
            size = -(-size // LEAST) * LEAST
            if self._pinned + size > PINNED_SHARE * _host_memory():
                self._drop(size)
                if self._pinned + size > PINNED_SHARE * _host_memory():
                    return None
            try:
                made = warp.empty(size, dtype=warp.uint8, device="cpu", pinned=True)
            except RuntimeError:
                return None
            self._pinned += size
            return made

    def give_back(self, buffer: Any) -> None:
        """What was taken, and no copy uses any more."""
        with self._lock:
            self._free.append(buffer)
            while sum(each.size for each in self._free) > KEPT:
                self._pinned -= self._free.pop(0).size

    def _drop(self, size: int) -> None:
        """Unpin memory that nothing uses, so many bytes of it or all."""
        while self._free and size > 0:
            gone = self._free.pop(0)
            self._pinned -= gone.size
            size -= gone.size


class Lent:
    """Pinned memory as NumPy reads it; given back when the last array that lies in it is gone.

    Attributes:
        buffer: The pinned warp.array.
        event: Recorded behind the copies that are on their way here; None where there are none.
        source: What they copy.
    """

    def __init__(self, buffer: Any, shape: tuple[int, ...], dtype: np.dtype):
        """Memory that was taken, for an array of this shape and type."""
        self.buffer = buffer
        self.event: Any = None
        self.source: Any = None
        self.__array_interface__ = {"data": (buffer.ptr, False), "shape": shape, "typestr": dtype.str, "version": 3}

    def wait(self) -> None:
        """Wait for the copies that are on their way here."""
        if self.event is not None:
            import warp

            warp.synchronize_event(self.event)
            self.event = self.source = None

    def __del__(self) -> None:
        """Give the memory back."""
        with suppress(Exception):  # the process may be ending
            self.wait()
            pinned_memory().give_back(self.buffer)


def pinned_memory() -> PinnedMemory:
    """That of this process."""
    memory: PinnedMemory = OPENED.once(("pinned memory", os.getpid()), PinnedMemory)
    return memory


def to_host(buffer: Any) -> np.ndarray:
    """A warp.array as a NumPy array: one of the CPU device itself, one of a GPU copied, through pinned memory if large.

    Waits for what was launched before.
    """
    import warp

    size = buffer.size * warp.types.type_size_in_bytes(buffer.dtype)
    if not buffer.device.is_cuda or size < LEAST:
        return np.asarray(buffer.numpy())
    taken = pinned_memory().take(size)
    if taken is None:
        return np.asarray(buffer.numpy())
    array = np.asarray(Lent(taken, *layout_of(buffer)))
    warp.copy(as_kind(taken, buffer.dtype, len(buffer)), buffer)
    warp.synchronize_stream(buffer.device)
    return array


def layout_of(buffer: Any) -> tuple[tuple[int, ...], np.dtype]:
    """Shape and type of a warp.array of one dimension, of numbers or of vectors, as NumPy has them."""
    import warp

    kind, width = buffer.dtype, int(getattr(buffer.dtype, "_length_", 1))
    number = np.dtype(warp.dtype_to_numpy(getattr(kind, "_wp_scalar_type_", kind)))
    return ((len(buffer), width) if width > 1 else (len(buffer),)), number


def bring(arrays: list[np.ndarray], buffers: list[Any], rows: int = ROWS) -> Iterator[slice]:
    """Copy rays to a GPU, chunk by chunk through pinned memory; gives each chunk as soon as what follows may use it.

    What is launched on the device's stream after a chunk was given finds it there, while the next one is on its way.

    Args:
        arrays: Arrays of as many rows, C-contiguous.
        buffers: A warp.array for each, as long, on one device.
        rows: How many go together.
    """
    import warp

    device, count = buffers[0].device, len(arrays[0])
    memory = pinned_memory()
    sizes = [array[:1].nbytes * min(rows, count) for array in arrays]
    slots = [[memory.take(size) for size in sizes] for _ in range(2)]
    is_pinned = device.is_cuda and all(taken is not None for slot in slots for taken in slot)
    stream = warp.Stream(device) if is_pinned else None
    if stream is not None:
        stream.wait_stream(device.stream)  # the buffers were allocated in its order
    events: list[Any] = [None, None]
    try:
        with ThreadPoolExecutor(min(THREADS, os.cpu_count() or 1)) as pool:
            for number, first in enumerate(range(0, count, rows)):
                chunk, turn = slice(first, min(first + rows, count)), number % 2
                if events[turn] is not None:
                    warp.synchronize_event(events[turn])
                _bring_chunk(pool, arrays, buffers, slots[turn] if is_pinned else None, chunk, stream)
                if stream is not None:
                    events[turn] = stream.record_event()
                    device.stream.wait_event(events[turn])
                yield chunk
    finally:
        for event in events:
            if event is not None:
                warp.synchronize_event(event)
        for taken in (taken for slot in slots for taken in slot if taken is not None):
            memory.give_back(taken)


def _bring_chunk(
    pool: ThreadPoolExecutor, arrays: list[np.ndarray], buffers: list[Any], slot: list | None, chunk: slice, stream: Any
) -> None:
    import warp

    count = chunk.stop - chunk.start
    staged = []
    for number, (array, buffer) in enumerate(zip(arrays, buffers, strict=True)):
        if slot is None:
            warp.copy(buffer, warp.array(array[chunk], dtype=buffer.dtype, device="cpu"), dest_offset=chunk.start)
        else:
            staged.append(as_kind(slot[number], buffer.dtype, count))
    if slot is None:
        return
    part = -(-count // THREADS)
    jobs = [
        (view.numpy()[first : first + part], array[chunk][first : first + part])
        for view, array in zip(staged, arrays, strict=True)
        for first in range(0, count, part)
    ]
    list(pool.map(lambda job: np.copyto(*job), jobs))
    for view, buffer in zip(staged, buffers, strict=True):
        warp.copy(buffer, view, dest_offset=chunk.start, count=count, stream=stream)


def as_kind(taken: Any, kind: Any, count: int) -> Any:
    """The first bytes of pinned memory as `count` elements of a type."""
    import warp

    return warp.array(ptr=taken.ptr, dtype=kind, shape=(count,), device="cpu", pinned=True)


def _host_memory() -> float:
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, OSError, ValueError):
        return float(8 << 30)
