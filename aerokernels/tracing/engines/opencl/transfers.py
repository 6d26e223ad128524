"""Repeated copies to and from an OpenCL device, which wait only if necessary."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyopencl as cl


class Mapped:
    """Host memory that the driver of a GPU has pinned; see device_arrays/pinned_memory.py.

    Attributes:
        size: Its bytes.
        ptr: Its address.
    """

    def __init__(self, context: Any, queue: Any, size: int):
        """Allocate a buffer in pinned memory, and map it for as long as this object lives.

        Raises:
            RuntimeError: There is no such memory left.
        """
        try:
            flags = cl.mem_flags.READ_WRITE | cl.mem_flags.ALLOC_HOST_PTR
            self._buffer = cl.Buffer(context, flags, size)
            access = cl.map_flags.READ | cl.map_flags.WRITE
            self._array, _ = cl.enqueue_map_buffer(queue, self._buffer, access, 0, (size,), np.uint8, is_blocking=True)
        except cl.Error as error:
            raise RuntimeError(f"{size} bytes of pinned memory cannot be allocated ({error})") from error
        self.size, self.ptr = size, self._array.ctypes.data


@dataclass(eq=False)
class Sent:
    """An array and its buffer, which share memory if there is no queue; see interface.py."""

    queue: Any
    array: np.ndarray
    buffer: Any

    def send(self) -> None:
        """Start the upload; the queue is in order, so later launches see it."""
        if self.queue is not None:
            cl.enqueue_copy(self.queue, self.buffer, self.array, is_blocking=False)


class Fetched:
    """Buffers and the host arrays that receive them, read in a single copy; see interface.py."""

    def __init__(self, session: Any, buffers: Sequence[Any], arrays: Sequence[np.ndarray], empty: Callable[[int], Any]):
        """Take the buffers; `empty` allocates a buffer of so many bytes, in which they are joined."""
        self.session, self.buffers = session, buffers
        sizes = [array.nbytes for array in arrays]
        self.starts = [-(-sum(sizes[:number]) // 8) * 8 for number in range(len(sizes))]
        self.bytes = np.zeros(self.starts[-1] + sizes[-1], np.uint8)
        self.joined = buffers[0] if len(buffers) == 1 else empty(len(self.bytes))
        self.arrays = [
            self.bytes[start : start + array.nbytes].view(array.dtype).reshape(array.shape)
            for start, array in zip(self.starts, arrays, strict=True)
        ]

    def start(self) -> None:
        """Join the buffers on the device: in separate reads, the driver would wait for the device each time."""
        if self.joined is self.buffers[0]:
            return
        for buffer, start, array in zip(self.buffers, self.starts, self.arrays, strict=True):
            cl.enqueue_copy(
                self.session.queue, self.joined, buffer, byte_count=array.nbytes, src_offset=0, dst_offset=start
            )

    def wait(self) -> Sequence[np.ndarray]:
        """Read the joined buffer, and return the arrays."""
        cl.enqueue_copy(self.session.queue, self.bytes, self.joined, is_blocking=True)
        return self.arrays
