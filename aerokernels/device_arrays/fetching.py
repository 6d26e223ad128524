"""Copy results from a GPU to the host chunk by chunk, while later ones are computed.

Copies run on a separate stream, into pinned memory. Rays copied from the host at the same time use the other direction
of the bus.
"""

from typing import Any

import numpy as np

from .pinned import as_kind, layout_of, pinned_memory
from .pinned_memory import Lent


class Coming:
    """An array that is being copied to the host."""

    def __init__(self, lent: Lent):
        """Store the memory that it is copied to."""
        self.lent = lent

    def arrived(self) -> np.ndarray:
        """Wait for the copy and return the array."""
        self.lent.wait()
        return np.asarray(self.lent)


class Fetching:
    """Copies arrays to the host, rows by rows in the order in which they are finished."""

    def __init__(self, buffers: dict[str, Any], memory: dict[str, Lent]):
        """Prepare for these arrays of a GPU, by name, and the memory pinned for each."""
        import warp

        from .launching import lent_stream

        self.buffers, self.memory = buffers, memory
        self.device = next(iter(buffers.values())).device
        self.stream, self.event = lent_stream(self, self.device), warp.Event(self.device)
        self.there = {name: as_kind(memory[name].buffer, each.dtype, len(each)) for name, each in buffers.items()}

    @classmethod
    def of(cls, buffers: dict[str, Any]) -> "Fetching | None":
        """Return the Fetching of arrays of a GPU, by name; None if so much memory cannot be pinned."""
        import warp

        memory = {}
        for name, buffer in buffers.items():
            taken = pinned_memory().take(buffer.size * warp.types.type_size_in_bytes(buffer.dtype))
            if taken is None:
                return None
            memory[name] = Lent(pinned_memory(), taken, *layout_of(buffer))
        return cls(buffers, memory)

    def rows(self, rows: slice) -> None:
        """Start to copy rows, in the state after everything launched before."""
        import warp

        self.stream.wait_stream(self.device.stream)
        first, count = rows.start, rows.stop - rows.start
        for name, buffer in self.buffers.items():
            there = self.there[name]
            warp.copy(there, buffer, dest_offset=first, src_offset=first, count=count, stream=self.stream)
        self.stream.record_event(self.event)
        for name, lent in self.memory.items():  # keep both ends of a copy alive until it has ended
            lent.event, lent.source = self.event, self.buffers[name]

    def coming(self) -> dict[str, Coming]:
        """Return the arrays by name; copies of all rows must have been started."""
        return {name: Coming(lent) for name, lent in self.memory.items()}
