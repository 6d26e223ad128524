"""Repeated copies to and from Warp's devices, and work that a GPU replays as one graph.

For a GPU the host memory of a copy is pinned, so that the copy can be part of a graph.
"""

import threading
import weakref
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import warp as wp

from ....device_arrays.pinned import as_kind, pinned_memory
from ....device_arrays.pinned_memory import LEAST


class Sent:
    """An array and its buffer; see interface.py."""

    def __init__(self, array: np.ndarray, buffer: wp.array):
        """Take an array and the buffer that has a copy of it or shares its memory."""
        self.array, self.buffer = array, buffer
        self._there: wp.array | None = None
        if buffer.device.is_cuda:
            self._there = _beside(buffer, self)
            self.array = self._there.numpy().reshape(array.shape)
            self.array[...] = array

    def send(self) -> None:
        """Start the upload; a stream is in order, so later launches see it."""
        if self._there is not None:
            wp.copy(self.buffer, self._there)


class Fetched:
    """Buffers and the host arrays that receive them; see interface.py."""

    def __init__(self, buffers: Sequence[wp.array], arrays: Sequence[np.ndarray]):
        """Take buffers with at least as many numbers as their arrays."""
        self.buffers = list(buffers)
        self._there = [_beside(buffer, self) for buffer in buffers]
        self.arrays = [
            there.numpy()[: array.size].reshape(array.shape) for there, array in zip(self._there, arrays, strict=True)
        ]

    def start(self) -> None:
        """Start the copies, on the stream of the launches."""
        for there, buffer in zip(self._there, self.buffers, strict=True):
            wp.copy(there, buffer)

    def wait(self) -> Sequence[np.ndarray]:
        """Wait for the stream, and return the arrays."""
        device = self.buffers[0].device
        if device.is_cuda:
            wp.synchronize_stream(device)
        return self.arrays


class Recorded:
    """Repeated work on a GPU: run directly the first time, when it may load modules; replayed as a graph afterwards.

    Threads share a device's stream: what another thread launched while a graph is recorded would become part of the
    graph, and not run. So the graph is recorded only if there is no other thread; until then the work runs directly.
    """

    def __init__(self, device: str):
        """Start without a graph."""
        self.device = device
        self._graph: Any = None
        self._was_done = False

    def __call__(self, work: Callable[[], None]) -> None:
        """Start the work."""
        if not self._was_done or (self._graph is None and threading.active_count() > 1):
            work()
            self._was_done = True
            return
        if self._graph is None:
            with wp.ScopedCapture(self.device, force_module_load=False) as capture:
                work()
            self._graph = capture.graph
        wp.capture_launch(self._graph)


def _beside(buffer: wp.array, owner: Any) -> wp.array:
    """Return a host array for the numbers of a buffer, as long as its owner lives; pinned if the buffer is on a GPU."""
    kind, size = buffer.dtype, buffer.size
    if not buffer.device.is_cuda:
        return wp.empty(size, dtype=kind, device="cpu")
    # Reuse pinned memory: to pin new memory would take longer than to trace a pupil.
    taken = pinned_memory().take(max(size * wp.types.type_size_in_bytes(kind), LEAST))
    if taken is None:
        return wp.empty(size, dtype=kind, device="cpu", pinned=True)
    weakref.finalize(owner, pinned_memory().give_back, taken).atexit = False
    return as_kind(taken, kind, size)
