"""Host memory that the driver of a GPU has pinned."""

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
