"""Copy samples to a Warp device through pinned memory, with several threads, while other work goes on.

A copy from memory that is not pinned goes through one small buffer of the driver, at a fraction of the bus's rate. So
samples of the host are copied in pieces: each thread puts a piece into pinned memory, from where the device fetches it
while the next pieces are put there. Pinned samples are fetched at once, and samples on the device stay where they are.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..process.machine import core_count

PIECE = 1 << 22  # [bytes] copied at a time
SLOTS = 4  # pieces of each thread in pinned memory
MOST_THREADS = 8


@dataclass(frozen=True, eq=False)
class DeviceSamples:
    """Samples on a device.

    Attributes:
        flat: A flat Warp array on the device, to which copies may be in progress.
        device: The device's name in Warp.
        precision: "float32" or "float64".
        done: Event at the end of the copies; None if they are complete.
    """

    flat: Any
    device: str
    precision: str
    done: Any = None

    def ready(self) -> Any:
        """Return the array, and make later work on the device wait until the copies are complete."""
        if self.done is not None:
            self.flat.device.stream.wait_event(self.done)
        return self.flat


def to_device(samples: Any, copies: "Copies") -> DeviceSamples:
    """Return samples on a device: a Warp array on a GPU stays there, others are copied by `copies`."""
    import warp as wp

    if isinstance(samples, wp.array) and (samples.device.is_cuda or copies.device == "cpu"):
        return DeviceSamples(samples.contiguous().flatten(), str(samples.device), samples.dtype.__name__)
    return copies(samples)


class Copies:
    """Copies host arrays to a device, alternating between two arrays there: one is used while the other is filled.

    Attributes:
        device: The device, by its name in Warp.
    """

    def __init__(self, device: str):
        """Prepare copies.

        Args:
            device: By its name in Warp.
        """
        from ..device_arrays.launching import lent_stream
        from ..process.quiet_warp import open_device

        open_device(device)
        self.device = device
        self._stream = None if device == "cpu" else lent_stream(self, device)
        self._threads = min(MOST_THREADS, max(2, core_count()))
        self._pool = ThreadPoolExecutor(self._threads)
        self._there: list[Any] = []
        self._slots: list[tuple[Any, np.ndarray, Any]] = []

    def __call__(self, samples: Any) -> DeviceSamples:
        """Start copying an array of float32 or float64; the array has been read completely when this returns.

        The result of the call before the last one is overwritten.
        """
        import warp as wp

        pinned = isinstance(samples, wp.array)
        kind = np.dtype(samples.dtype.__name__) if pinned else samples.dtype
        real: Any = {"float32": wp.float32, "float64": wp.float64}[kind.name]
        if len(self._there) == 2:
            self._there.append(self._there.pop(0))
            if self._there[-1].dtype is not real or self._there[-1].size != samples.size:
                self._there.pop()
        if len(self._there) < 2:
            self._there.append(wp.empty(samples.size, dtype=real, device=self.device))
        target = self._there[-1]
        if self._stream is not None:  # kernels launched before may still use the array
            self._stream.wait_stream(wp.get_stream(self.device))
        if pinned:
            wp.copy(target, samples.contiguous().flatten(), stream=self._stream)
        else:
            self._in_pieces(target, samples, real)
        done = None if self._stream is None else self._stream.record_event()
        if pinned and done is not None:
            wp.synchronize_event(done)
        return DeviceSamples(target, self.device, kind.name, done)

    def _in_pieces(self, target: Any, samples: np.ndarray, real: Any) -> None:
        """Copy an array, some of its first axis at a time."""
        row = samples[:1].size
        rows = max(1, PIECE // max(1, row * samples.itemsize))
        if not self._slots or self._slots[0][0].dtype is not real or self._slots[0][0].size < rows * row:
            self._slots = [self._slot(rows * row, real) for _ in range(SLOTS * self._threads)]
        starts = range(0, len(samples), rows)

        def copied(thread: int) -> None:  # each thread fills its own slots one after another
            for turn, first in enumerate(starts[thread :: self._threads]):
                slot = self._slots[SLOTS * thread + turn % SLOTS]
                self._piece(target, samples[first : first + rows], first * row, *slot)

        list(self._pool.map(copied, range(self._threads)))

    def _slot(self, size: int, real: Any) -> tuple[Any, np.ndarray, Any]:
        """Return pinned memory, the same memory as a NumPy array, and the event of the last copy from it."""
        import warp as wp

        cuda = self._stream is not None
        memory = wp.empty(size, dtype=real, device="cpu", pinned=cuda)
        return memory, np.asarray(memory), wp.Event(self.device) if cuda else None

    def _piece(self, target: Any, samples: np.ndarray, first: int, memory: Any, here: np.ndarray, done: Any) -> None:
        """Copy one piece through a slot."""
        import warp as wp

        if done is not None:
            wp.synchronize_event(done)  # the slot may be overwritten only after it has been fetched
        np.copyto(here[: samples.size].reshape(samples.shape), samples)
        wp.copy(target, memory, first, 0, samples.size, stream=self._stream)
        if done is not None:
            assert self._stream is not None
            self._stream.record_event(done)
