"""Large arrays that several threads copy and scan: the same numbers as NumPy's, whatever the number of cores."""

import threading

import numpy as np
import pytest

from aerokernels.process import threads
from aerokernels.process.threads import copy_and_scan, copy_over, extremes_of, thread_count


@pytest.mark.parametrize("cores", [1, 4])
@pytest.mark.parametrize("shape", [(300, 1000), (3, 40000), (2, 5, 9), (1, 1)])
def test_arrays_are_copied_and_scanned_whole(monkeypatch, cores: int, shape: tuple[int, ...]):
    """In pieces of a few rows and in one piece; other types and orders of memory are converted."""
    monkeypatch.setattr(threads, "own_cores", lambda: cores)
    monkeypatch.setattr(threads, "PIECE", 20000)
    values = np.random.default_rng(9).normal(size=shape)
    for given in (values, np.asfortranarray(values), values.astype(np.float32), np.arange(values.size).reshape(shape)):
        into = np.full(shape, np.nan)
        copy_over(into, given)
        np.testing.assert_array_equal(into, given)
        assert extremes_of(into) == (given.min(), given.max())
        again = np.full(shape, np.nan)
        assert copy_and_scan(again, given) == (given.min(), given.max())
        np.testing.assert_array_equal(again, given)
    values[-1, -1] = np.nan
    assert np.isnan(extremes_of(values)).all() and np.isnan(copy_and_scan(into, values)).all()


def test_threads_that_scan_are_not_counted(monkeypatch):
    """They start nothing; a thread of anyone else is counted."""
    monkeypatch.setattr(threads, "own_cores", lambda: 4)
    before = thread_count()
    extremes_of(np.zeros((4096, 2048)))
    assert thread_count() == before <= threading.active_count()
    go = threading.Event()
    other = threading.Thread(target=go.wait)
    other.start()
    assert thread_count() == before + 1
    go.set()
    other.join()
