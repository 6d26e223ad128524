"""Repeated copies to and from an OpenCL device, which wait only if necessary, and work that is started repeatedly."""

import ctypes
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyopencl as cl

from aerokernels.process.threads import copy_over

from ....device_arrays.pinned_memory import LEAST
from .session import Session


@dataclass(eq=False)
class Sent:
    """An array and its buffer, which share memory on a processor; see interface.py.

    Attributes:
        session: The open device.
        array: The array.
        buffer: The buffer.
        is_copied: Whether the buffer has memory of its own.
        event: The event of the last upload: PyOpenCL would wait for the copy if the event were deleted.
    """

    session: Session
    array: np.ndarray
    buffer: Any
    is_copied: bool
    event: Any = None

    def send(self, values: np.ndarray | None = None) -> None:
        """Start the upload; the queue is in order, so later launches see it."""
        if values is not None:
            copy_over(self.array, values)
        if self.is_copied:
            self.session.do(self._start)

    def _start(self) -> None:
        self.event = cl.enqueue_copy(self.session.queue, self.buffer, self.array, is_blocking=False)


class Fetched:
    """Parts of one buffer of a GPU, and the host arrays that receive them in a single copy; see interface.py.

    In separate reads, the driver would wait for the device each time.
    """

    def __init__(self, session: Session, arrays: Sequence[np.ndarray], empty: Callable[[int], Any]):
        """Make a buffer for arrays like these; `empty` allocates a buffer of so many bytes."""
        self.session = session
        unit = max(session.device.mem_base_addr_align // 8, 1)  # bytes; a part of a buffer begins at a multiple
        starts, end = [], 0
        for array in arrays:
            starts.append(end)
            end += -(-max(array.nbytes, 1) // unit) * unit
        self.bytes, self.whole = _pinned(session, end, self), empty(end)
        self.event: Any = None
        # A buffer from a pool cannot be divided itself.
        divided = cl.Buffer.from_int_ptr(self.whole.int_ptr, retain=True)
        self.buffers: Sequence[Any] = [
            divided.get_sub_region(start, max(array.nbytes, 1)) for start, array in zip(starts, arrays, strict=True)
        ]
        self.arrays: Sequence[np.ndarray] = [
            self.bytes[start : start + array.nbytes].view(array.dtype).reshape(array.shape)
            for start, array in zip(starts, arrays, strict=True)
        ]

    def start(self) -> None:
        """Start the copy; the queue is in order."""
        self.session.do(self._start)

    def _start(self) -> None:
        self.event = cl.enqueue_copy(self.session.queue, self.bytes, self.whole, is_blocking=False)

    def wait(self) -> Sequence[np.ndarray]:
        """Wait for the copy, and return the arrays."""
        self.event.wait()
        return self.arrays

    def taken(self) -> Sequence[np.ndarray]:
        """Wait, and return copies: pinned memory is used again."""
        return [array.copy() for array in self.wait()]


@dataclass(eq=False)
class Shared:
    """Host arrays, and a processor's buffers in their memory; see interface.py."""

    session: Session
    arrays: Sequence[np.ndarray]
    buffers: Sequence[Any]

    def start(self) -> None:
        """Do nothing: kernels write into the arrays."""

    def wait(self) -> Sequence[np.ndarray]:
        """Wait for the kernels that this thread launched, and return the arrays."""
        self.session.queue.finish()
        return self.arrays

    def taken(self) -> Sequence[np.ndarray]:
        """Wait, and return the arrays."""
        return self.wait()


def _pinned(session: Session, size: int, owner: Any) -> np.ndarray:
    """Return so many bytes on the host as long as the owner lives, pinned for fast copies if more may be pinned."""
    taken = session.pinned.take(max(size, LEAST))
    if taken is None:
        return np.empty(size, np.uint8)
    weakref.finalize(owner, session.pinned.give_back, taken).atexit = False
    return np.ctypeslib.as_array((ctypes.c_uint8 * size).from_address(taken.ptr))


class Recorded:
    """Repeated work: its launches and uploads are recorded the first time, and started again afterwards."""

    def __init__(self, session: Session):
        """Start without a record."""
        self.session = session
        self._steps: list[Callable[[], Any]] | None = None

    def __call__(self, work: Callable[[], None]) -> None:
        """Start the work."""
        if self._steps is None:
            self._steps = self.session.recorded(work)
            return
        for step in self._steps:
            step()
