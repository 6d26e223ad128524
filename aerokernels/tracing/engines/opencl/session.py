"""An open OpenCL device, with the objects that are cached as long as it is open."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from ....device_arrays.pinned_memory import PinnedMemory


@dataclass(frozen=True, eq=False)
class Session:
    """An open device.

    Attributes:
        name: Name of the device.
        device: PyOpenCL's device.
        context: Its context.
        first_queue: Its first queue, in order.
        options: Compile options that the device needs.
        sources: Expanded sources, by file, folder and stamp.
        programs: Built programs, by source and options.
        launched: Programs that have been launched.
        looked: When the package's sources were last checked, their folder and stamp, and programs built from them.
        options_of: Compile options by the choices that they were made from.
        kernels: Kernels that are out of use, by program and name.
        lock: Held while a program is built.
        own: The queue of each thread, on a CPU, and the launches and copies that the thread records.
    """

    name: str
    device: Any
    context: Any
    first_queue: Any
    options: tuple[str, ...] = ()
    sources: dict = field(default_factory=dict, repr=False)
    programs: dict = field(default_factory=dict, repr=False)
    launched: set = field(default_factory=set, repr=False)
    looked: dict = field(default_factory=dict, repr=False)
    options_of: dict = field(default_factory=dict, repr=False)
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

    @property
    def recording(self) -> list[Callable[[], Any]] | None:
        """The launches and copies that this thread records, see `recorded`; None if it does not."""
        return getattr(self.own, "steps", None)

    def do(self, step: Callable[[], Any]) -> Any:
        """Start a launch or a copy, and record it if this thread records; return its event."""
        if self.recording is not None:
            self.recording.append(step)
        return step()

    def recorded(self, work: Callable[[], None]) -> list[Callable[[], Any]]:
        """Do some work; return the launches and copies that this thread started through this session meanwhile."""
        steps: list[Callable[[], Any]] = []
        self.own.steps = steps
        try:
            work()
        finally:
            self.own.steps = None
        return steps

    @cached_property
    def pinned(self) -> PinnedMemory:
        """Cache of host memory that a GPU's driver has pinned."""
        from .mapped import Mapped

        return PinnedMemory(lambda size: Mapped(self.context, self.first_queue, size))

    @cached_property
    def pool(self) -> Any:
        """Pool of GPU memory, because an allocation takes longer than tracing some rays; None on a CPU."""
        import pyopencl as cl

        if not self.device.type & cl.device_type.GPU:
            return None
        from pyopencl.tools import ImmediateAllocator, MemoryPool

        return MemoryPool(ImmediateAllocator(self.first_queue))
