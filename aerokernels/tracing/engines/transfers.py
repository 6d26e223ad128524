"""Arrays that are copied to a device, or from it, repeatedly; engines for GPUs have classes of their own for both."""

from collections.abc import Sequence
from typing import Any

import numpy as np


class Sent:
    """An array on the host and the buffer to which it is uploaded, see `Engine.sent`; on a CPU they share memory.

    Attributes:
        array: Write it before `send`; leave it unchanged until the kernels launched after `send` have ended.
        buffer: The buffer on the device.
    """

    def __init__(self, array: np.ndarray, buffer: Any):
        """Take an array and its buffer."""
        self.array, self.buffer = array, buffer

    def send(self) -> None:
        """Start the upload; kernels launched after this call read the new values."""


class Fetched:
    """Buffers and the host arrays that receive them; see `Engine.fetched`. On a CPU they share memory.

    Attributes:
        buffers: One for each array; they are valid as long as this object.
        arrays: Those that `wait` returns, always the same ones.
    """

    def __init__(self, engine: Any, arrays: Sequence[np.ndarray], buffers: Sequence[Any]):
        """Take arrays and their buffers."""
        self.engine, self.arrays, self.buffers = engine, arrays, buffers

    def start(self) -> None:
        """Start to copy the buffers in the state that the kernels launched so far leave them in."""

    def wait(self) -> Sequence[np.ndarray]:
        """Wait for the copies and return the arrays, which are valid until the next `start`."""
        self.engine.wait()
        return self.arrays

    def taken(self) -> Sequence[np.ndarray]:
        """Wait for the last copies; return arrays that stay valid."""
        return self.wait()


class FetchedFromGPU(Fetched):
    """Parts of one buffer of a GPU, and parts of one host array that receives it in a single copy.

    In separate reads, the driver would wait for the device each time.
    """

    def __init__(self, engine: Any, arrays: Sequence[np.ndarray], unit: int):
        """Lay out arrays like these; a part of the buffer begins at a multiple of `unit` bytes."""
        self.starts, self.size = [], 0
        for array in arrays:
            self.starts.append(self.size)
            self.size += -(-max(array.nbytes, 1) // unit) * unit
        super().__init__(engine, arrays, ())

    def place(self, host: np.ndarray, buffers: Sequence[Any]) -> None:
        """Take the buffers, and the bytes on the host."""
        self.buffers = buffers
        self.arrays = [
            host[start : start + array.nbytes].view(array.dtype).reshape(array.shape)
            for start, array in zip(self.starts, self.arrays, strict=True)
        ]

    def taken(self) -> Sequence[np.ndarray]:
        """Wait, and return copies: pinned memory is used again."""
        return [array.copy() for array in self.wait()]
