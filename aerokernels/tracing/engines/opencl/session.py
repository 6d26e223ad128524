"""An open OpenCL device, with the objects that are cached as long as it is open, and the kernels launched on it."""

import threading
import weakref
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ....device_arrays.pinned import PinnedMemory

# Work-items of a work-group. Global sizes are rounded up to whole groups, and kernels test `ray < ray_count`.
WORK_GROUP = 64


@dataclass(frozen=True, eq=False)
class Session:
    """An open device.

    Attributes:
        name: Name of the device.
        device: PyOpenCL's device.
        context: Its context.
        first_queue: Its first queue, in order.
        options: Compile options that the device needs.
        programs: Built programs, by file and options.
        launched: Programs that have been launched.
        kernels: PyOpenCL's kernel objects that are out of use, by program and name.
        lock: Held while a program is built.
        own: The queue of each thread, on a CPU.
    """

    name: str
    device: Any
    context: Any
    first_queue: Any
    options: tuple[str, ...] = ()
    programs: dict = field(default_factory=dict, repr=False)
    launched: set = field(default_factory=set, repr=False)
    kernels: dict = field(default_factory=dict, repr=False)
    lock: Any = field(default_factory=threading.RLock, repr=False)
    own: threading.local = field(default_factory=threading.local, repr=False)

    @property
    def queue(self) -> Any:
        """A queue, in order: on a CPU each thread's own, so that no thread waits for the launches of others.

        Before a thread passes results to another thread, it waits for its launches: see `Engine.settle`.
        """
        if self.pool is not None:
            return self.first_queue
        if not hasattr(self.own, "queue"):
            import pyopencl as cl

            self.own.queue = cl.CommandQueue(self.context, self.device)
        return self.own.queue

    @cached_property
    def pinned(self) -> PinnedMemory:
        """Cache of host memory that a GPU's driver has pinned."""
        return PinnedMemory(lambda size: Mapped(self.context, self.first_queue, size))

    @cached_property
    def pool(self) -> Any:
        """Pool of GPU memory, because an allocation takes longer than tracing some rays; None on a CPU."""
        import pyopencl as cl

        if not self.device.type & cl.device_type.GPU:
            return None
        from pyopencl.tools import ImmediateAllocator, MemoryPool

        return MemoryPool(ImmediateAllocator(self.first_queue))


class Mapped:
    """Host memory that the driver of a GPU has pinned; see device_arrays/pinned.py.

    Attributes:
        size: Its bytes.
        ptr: Its address.
    """

    def __init__(self, context: Any, queue: Any, size: int):
        """Allocate a buffer in pinned memory, and map it for as long as this object lives.

        Raises:
            RuntimeError: There is no such memory left.
        """
        import pyopencl as cl

        try:
            flags = cl.mem_flags.READ_WRITE | cl.mem_flags.ALLOC_HOST_PTR
            self._buffer = cl.Buffer(context, flags, size)
            access = cl.map_flags.READ | cl.map_flags.WRITE
            self._array, _ = cl.enqueue_map_buffer(queue, self._buffer, access, 0, (size,), np.uint8, is_blocking=True)
        except cl.Error as error:
            raise RuntimeError(f"{size} bytes of pinned memory cannot be allocated ({error})") from error
        self.size, self.ptr = size, self._array.ctypes.data


# By type, since a launch has some forty arguments, most of them buffers.
CONVERSIONS: dict[type, Callable[[Any], Any]] = {int: np.int32, bool: np.int32, float: np.float64}


class Kernel:
    """A kernel object with one owner, whose arguments are set one by one.

    Attributes:
        kernel: PyOpenCL's kernel object; it is reused after this one is garbage-collected, because to make one takes
            half a millisecond.
        lanes: Rays that a work-item moves.
        items: Work-items per ray or group of the launch.
        group: Work-items of a work-group.
    """

    def __init__(
        self, session: Session, program: Any, name: str, lanes: int = 1, items: int = 1, group: int = WORK_GROUP
    ):
        """Take or make a kernel object of a session's program."""
        self.lanes, self.items, self.group = lanes, items, group
        import pyopencl as cl

        free = session.kernels.setdefault((program, name), [])
        try:
            self.kernel = free.pop()
        except IndexError:
            self.kernel = cl.Kernel(program, name)
        weakref.finalize(self, free.append, self.kernel).atexit = False
        self._arguments: list = []

    def set(self, arguments: list) -> None:
        """Set the arguments that have changed since the last launch.

        They are set one by one, because calling the kernel would use PyOpenCL's launchers, which PyOpenCL caches on
        disk and which a damaged file would make unusable.
        """
        if arguments is self._arguments:
            return
        before = self._arguments or [None] * len(arguments)
        for number, (new, old) in enumerate(zip(arguments, before, strict=True)):
            kind = type(new)
            if new is old or ((kind is int or kind is float) and kind is type(old) and new == old):
                continue
            if kind in CONVERSIONS:
                self.kernel.set_arg(number, CONVERSIONS[kind](new))
            elif kind is np.ndarray and new.shape == (3,):  # a double3, in place of a packed struct
                self.kernel.set_arg(number, np.array([*new, 0.0]))
            else:
                self.kernel.set_arg(number, new)
        self._arguments = arguments

    def size(self, count: int) -> tuple[int]:
        """Number of work-items of a launch: whole work-groups, at least one; the kernel ignores the surplus."""
        return (max(1, -(-(-(-count // self.lanes) * self.items) // self.group)) * self.group,)
