"""Pinned memory and forks, by shared memory of the operating system in its place."""

import gc
import mmap
import os
import signal

import numpy as np
import pytest

from aerokernels.device_arrays.pinned import Lent, PinnedMemory

SHAPE = (40, 60, 70)  # 1.3 MB
SIZE = 8 * int(np.prod(SHAPE))


class Shared:
    """Memory that a forked child shares, as pinned memory is."""

    def __init__(self, size: int):
        """Map it."""
        self.size, self._mapped = size, mmap.mmap(-1, size)
        self.ptr = np.frombuffer(self._mapped, np.uint8).ctypes.data


@pytest.fixture
def memory() -> PinnedMemory:
    """A cache of such memory."""
    return PinnedMemory(Shared)


def lent(memory: PinnedMemory, number: float) -> np.ndarray:
    """An array of equal values in this memory."""
    array = np.asarray(Lent(memory, memory.take(SIZE), SHAPE, np.dtype(float)))
    array[...] = number
    return array


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
@pytest.mark.filterwarnings("ignore:.*multi-threaded, use of fork")
def test_a_forked_child_keeps_its_values(memory: PinnedMemory):
    """The parent's next array takes other memory; the child takes none, and gives none back."""
    first = lent(memory, 1.0)
    ready, go = os.pipe()
    child = os.fork()
    if not child:
        signal.alarm(30)  # if the parent fails
        os.read(ready, 1)
        kept, own = bool((first == 1.0).all()), memory.take(SIZE) is None
        del first
        os._exit(0 if kept and own else 1)
    del first
    gc.collect()
    second = lent(memory, 2.0)
    os.write(go, b"1")
    ended = os.waitpid(child, 0)[1]
    assert (second == 2.0).all() and ended == 0
