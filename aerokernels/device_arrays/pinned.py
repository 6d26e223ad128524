"""Warp's copies between host and GPU through pinned memory, which the GPU accesses directly at full speed."""

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from ..process.machine import core_count
from ..process.opened import OPENED
from .pinned_memory import LEAST, Lent, PinnedMemory

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

    if not buffer.device.is_cuda or not len(buffer):
        return np.asarray(buffer)
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
