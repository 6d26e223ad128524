"""Pinned memory set aside for samples of fields, by shared memory of the operating system in its place."""

import gc
import mmap
import os
import signal

import numpy as np
import pytest

from aerokernels import IndexField
from aerokernels.device_arrays import pinned_memory
from aerokernels.device_arrays.pinned_memory import PinnedMemory, unused_array
from aerokernels.process.opened import OPENED

SHAPE = (40, 60, 70)  # 1.3 MB
SIZE = 8 * int(np.prod(SHAPE))


class Shared:
    """Memory that a forked child shares, as pinned memory is."""

    def __init__(self, size: int):
        """Map it."""
        self.size, self._mapped = size, mmap.mmap(-1, size)
        self.ptr = np.frombuffer(self._mapped, np.uint8).ctypes.data


@pytest.fixture
def memory(monkeypatch) -> PinnedMemory:
    """A cache of such memory, the only one with memory set aside."""
    monkeypatch.setattr(OPENED, "_held", {**OPENED._held, pinned_memory.ASIDE: []})
    return PinnedMemory(Shared)


def field(number: float) -> IndexField:
    values = np.full(SHAPE, 1e-6 * number)
    return IndexField.from_samples(values, origin=(0.0,) * 3, spacing=(1e-3,) * 3, geometry="volume")


def test_fields_take_what_is_set_aside_and_give_it_back(memory: PinnedMemory):
    """Two of three fields; none before, none of another size; a copy of a grid keeps its memory."""
    assert not memory.holds(field(1).samples.samples)
    memory.set_aside(SIZE, 2)
    fields = [field(number) for number in (1, 2, 3)]
    assert [memory.holds(each.samples.samples) for each in fields] == [True, True, False]
    assert [float(each.samples.samples[1, 2, 3]) for each in fields] == [1e-6, 2e-6, 3e-6]
    assert not memory.holds(unused_array((40, 60, 30), np.dtype(float)))
    kept = fields[0].samples.samples[3:5]
    place = fields[0].samples.samples.ctypes.data
    del fields
    gc.collect()
    again = [field(number) for number in (4, 5)]
    assert [memory.holds(each.samples.samples) for each in again] == [True, False]  # a view keeps its memory
    assert (kept == 1e-6).all() and again[0].samples.samples.ctypes.data != place
    assert memory.holds(again[0].samples.samples.reshape(-1)) and memory.holds(kept)


def test_another_grid_of_the_same_samples_does_not_copy_them(memory: PinnedMemory):
    from dataclasses import replace

    memory.set_aside(SIZE, 1)
    first = field(1).samples
    assert replace(first).samples is first.samples


def test_no_more_is_set_aside_than_is_pinned(memory: PinnedMemory, monkeypatch):
    monkeypatch.setattr(pinned_memory, "host_memory", lambda: 5.0 * SIZE)  # a quarter of it may be pinned
    memory.set_aside(SIZE, 3)
    assert [memory.holds(each.samples.samples) for each in [field(1), field(2)]] == [False, False]
    monkeypatch.setattr(pinned_memory, "host_memory", lambda: 100.0 * SIZE)
    monkeypatch.setattr(pinned_memory, "MOST_ASIDE", SIZE)
    memory.set_aside(SIZE, 3)
    fields = [field(1), field(2)]
    assert [memory.holds(each.samples.samples) for each in fields] == [True, False]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
@pytest.mark.filterwarnings("ignore:.*multi-threaded, use of fork")
def test_a_forked_child_keeps_its_values(memory: PinnedMemory):
    """The parent's next field takes other memory; the child takes none, and gives none back."""
    memory.set_aside(SIZE, 2)
    first = field(1)
    ready, go = os.pipe()
    child = os.fork()
    if not child:
        signal.alarm(30)  # if the parent fails
        os.read(ready, 1)
        kept, other = bool((first.samples.samples == 1e-6).all()), field(3)
        own = not memory.holds(other.samples.samples)
        del first, other
        os._exit(0 if kept and own else 1)
    del first
    gc.collect()
    memory.set_aside(SIZE, 1)
    second = field(2)
    os.write(go, b"1")
    ended = os.waitpid(child, 0)[1]
    assert memory.holds(second.samples.samples) and ended == 0
