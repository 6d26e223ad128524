"""Copies to and from Warp's devices that are made again and again, and work that a GPU repeats as one graph.

On a GPU the host's side of a copy is pinned, so that the copy can be part of a graph.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import warp as wp


class Sent:
    """An array and its buffer; see interface.py."""

    def __init__(self, array: np.ndarray, buffer: wp.array):
        """A buffer that holds the array, or lies in its memory."""
        self.array, self.buffer = array, buffer
        self._there: wp.array | None = None
        if buffer.device.is_cuda:
            self._there = _beside(buffer)
            self.array = self._there.numpy().reshape(array.shape)
            self.array[...] = array

    def send(self) -> None:
        """Start to copy it: a stream is in order."""
        if self._there is not None:
            wp.copy(self.buffer, self._there)


class Fetched:
    """Buffers and the arrays they come to; see interface.py."""

    def __init__(self, buffers: Sequence[wp.array], arrays: Sequence[np.ndarray]):
        """Buffers of at least as many numbers as their arrays have."""
        self.buffers = list(buffers)
        self._there = [_beside(buffer) for buffer in buffers]
        self.arrays = [
            there.numpy()[: array.size].reshape(array.shape) for there, array in zip(self._there, arrays, strict=True)
        ]

    def start(self) -> None:
        """Start to bring them, on the stream of the launches."""
        for there, buffer in zip(self._there, self.buffers, strict=True):
            wp.copy(there, buffer)

    def wait(self) -> Sequence[np.ndarray]:
        """The arrays, once the stream has come so far."""
        device = self.buffers[0].device
        if device.is_cuda:
            wp.synchronize_stream(device)
        return self.arrays


class Recorded:
    """The same work on a GPU: done as it is the first time, when it may load what it needs; a graph from then on."""

    def __init__(self, device: str):
        """Nothing is done yet."""
        self.device = device
        self._graph: Any = None
        self._was_done = False

    def __call__(self, work: Callable[[], None]) -> None:
        """Start it."""
        if not self._was_done:
            work()
            self._was_done = True
            return
        if self._graph is None:
            with wp.ScopedCapture(self.device, force_module_load=False) as capture:
                work()
            self._graph = capture.graph
        wp.capture_launch(self._graph)


def _beside(buffer: wp.array) -> wp.array:
    """An array on the host for the numbers of a buffer; pinned where that is on a GPU."""
    flat = buffer.flatten()
    return wp.empty(len(flat), dtype=buffer.dtype, device="cpu", pinned=buffer.device.is_cuda)
