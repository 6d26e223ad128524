"""An open device of OpenCL, and what is kept for as long as it is."""

import threading
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any


@dataclass(frozen=True, eq=False)
class Session:
    """An open device: its context, its first queue (in order), sources read and programs built for it, those launched.

    `looked` is when the package's sources were looked at and what was found, `kernels` those that nobody uses, by
    program and name.
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
    kernels: dict = field(default_factory=dict, repr=False)
    lock: Any = field(default_factory=threading.RLock, repr=False)
    own: threading.local = field(default_factory=threading.local, repr=False)

    @property
    def queue(self) -> Any:
        """A queue, in order: on a processor the thread's own, so that no thread waits for what others have launched.

        What one thread launches there has ended before another one is given what it made: see `Engine.settle`.
        """
        if self.pool is not None:
            return self.first_queue
        if not hasattr(self.own, "queue"):
            import pyopencl as cl

            self.own.queue = cl.CommandQueue(self.context, self.device)
        return self.own.queue

    @cached_property
    def pool(self) -> Any:
        """Memory of a GPU that is used again, since it takes longer to get than rays to trace; None on a processor."""
        import pyopencl as cl

        if not self.device.type & cl.device_type.GPU:
            return None
        from pyopencl.tools import ImmediateAllocator, MemoryPool

        return MemoryPool(ImmediateAllocator(self.first_queue))
