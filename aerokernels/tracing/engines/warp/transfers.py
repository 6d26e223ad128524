"""Repeated copies to and from Warp's devices, and work that a GPU replays as one graph.

For a GPU the host memory of a copy is pinned, so that the copy can be part of a graph.
"""

import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from aerokernels.process.threads import copy_over, thread_count

from ....device_arrays.pinned import as_kind, pinned_memory
from ....device_arrays.pinned_memory import LEAST

# A part of a piece of a GPU's memory begins at a multiple of this number of bytes.
PART = 256


class Sent:
    """An array and its buffer; see interface.py."""

    def __init__(self, array: np.ndarray, buffer: wp.array):
        """Take an array and the buffer to which it is copied, or which shares its memory."""
        self.array, self.buffer = array, buffer
        self._there: wp.array | None = None
        if buffer.device.is_cuda:
            self._there = _beside(buffer, self)
            self.array = np.asarray(self._there).reshape(array.shape)

    def send(self, values: np.ndarray | None = None) -> None:
        """Start the upload; a stream is in order, so later launches see it."""
        if values is not None:
            copy_over(self.array, values)
        if self._there is not None:
            wp.copy(self.buffer, self._there)


class Fetched:
    """Parts of one piece of a GPU's memory, and the host arrays that receive them in one copy; see interface.py."""

    def __init__(self, device: str, arrays: Sequence[np.ndarray], kinds: Sequence[tuple[type, int]]):
        """Allocate memory for arrays like these; `kinds` are Warp's type of an array's entries, and their number."""
        self._device, starts, end = device, [], 0
        for array in arrays:
            starts.append(end)
            end += -(-max(array.nbytes, 1) // PART) * PART
        self._whole = wp.empty(end // 8, dtype=wp.float64, device=device)
        self._there = _beside(self._whole, self)
        parts: list[wp.array] = []
        bytes_there = np.asarray(self._there).view(np.uint8)
        arrays_there: list[np.ndarray] = []
        for array, start, (kind, count) in zip(arrays, starts, kinds, strict=True):
            part = wp.array(
                ptr=self._whole.ptr + start, dtype=kind, shape=(count,), capacity=array.nbytes, device=device
            )
            part._ref = self._whole  # keeps the memory alive
            parts.append(part)
            arrays_there.append(bytes_there[start : start + array.nbytes].view(array.dtype).reshape(array.shape))
        self.buffers: Sequence[Any] = parts
        self.arrays: Sequence[np.ndarray] = arrays_there

    def start(self) -> None:
        """Start the copy, on the stream of the launches."""
        wp.copy(self._there, self._whole)

    def wait(self) -> Sequence[np.ndarray]:
        """Wait for the stream, and return the arrays."""
        wp.synchronize_stream(self._device)
        return self.arrays

    def taken(self) -> Sequence[np.ndarray]:
        """Wait, and return copies: pinned memory is used again."""
        return [array.copy() for array in self.wait()]


@dataclass(eq=False)
class Shared:
    """Host arrays, and buffers of a CPU in their memory; see interface.py."""

    arrays: Sequence[np.ndarray]
    buffers: Sequence[Any]

    def start(self) -> None:
        """Do nothing: kernels write into the arrays."""

    def wait(self) -> Sequence[np.ndarray]:
        """Return the arrays: a launch on the CPU has ended when it returns."""
        return self.arrays

    def taken(self) -> Sequence[np.ndarray]:
        """Return the arrays."""
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
        if not self._was_done or (self._graph is None and thread_count() > 1):
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
