"""Copies to and from an OpenCL device that are made again and again, without waiting where none is needed."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyopencl as cl


@dataclass(frozen=True, eq=False)
class Sent:
    """An array and its buffer; see interface.py."""

    queue: Any
    array: np.ndarray
    buffer: Any

    def send(self) -> None:
        """Start to copy it: the queue is in order."""
        cl.enqueue_copy(self.queue, self.buffer, self.array, is_blocking=False)


@dataclass(frozen=True, eq=False)
class Fetched:
    """Buffers and their arrays; see interface.py."""

    queue: Any
    buffers: Sequence[Any]
    arrays: Sequence[np.ndarray]

    def start(self) -> None:
        """Nothing yet: drivers wait for the device where an array is not pinned."""

    def wait(self) -> Sequence[np.ndarray]:
        """The arrays: the last copy is waited for, and with it, in order, all others."""
        *others, last = zip(self.buffers, self.arrays, strict=True)
        for buffer, array in others:
            cl.enqueue_copy(self.queue, array, buffer, is_blocking=False)
        cl.enqueue_copy(self.queue, last[1], last[0], is_blocking=True)
        return self.arrays
