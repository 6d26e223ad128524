"""Work in threads: results in order, cores divided among threads that start threads, arrays in pieces."""

import threading

import numpy as np
import pytest

from aerokernels.process import threads
from aerokernels.process.threads import copy_and_scan, copy_over, extremes_of, product_on_one_core


def names_of(work_in) -> set[str]:
    """The threads that process eight pieces."""
    found = set()
    work_in(lambda _: found.add(threading.current_thread().name), range(8))
    return found


def test_threads_of_a_thread_use_its_share_of_the_cores(monkeypatch):
    """Six cores, two things at a time: three threads each. With two cores, each works alone."""
    for cores, share in ((6, 3), (2, 1)):
        monkeypatch.setattr(threads, "core_count", lambda cores=cores: cores)
        asked = []
        pool = threads.ThreadPoolExecutor
        monkeypatch.setattr(
            threads,
            "ThreadPoolExecutor",
            lambda count, _asked=asked, _pool=pool, **more: (_asked.append(count), _pool(count, **more))[1],
        )
        found = list(threads.in_turn(lambda _: names_of(threads.in_threads), range(3), 2))
        assert asked == [2] + [share] * 3 * (share > 1)
        assert share > 1 or all(len(names) == 1 for names in found)
        monkeypatch.setattr(threads, "ThreadPoolExecutor", pool)
        assert threading.current_thread().name not in names_of(threads.in_threads)  # no share remains


def test_an_interrupted_consumer_leaves_no_work():
    """What has begun ends, what has not begun never does, and no thread remains."""
    before, begun = threading.active_count(), []
    found = threads.in_turn(lambda number: begun.append(number) or number, iter(range(10)), 2)
    assert next(found) == 0
    with pytest.raises(KeyboardInterrupt):
        found.throw(KeyboardInterrupt)
    assert len(begun) <= 3 and threading.active_count() == before


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


@pytest.mark.parametrize("kind", [np.float32, np.complex128])
@pytest.mark.parametrize("stack", [(), (3,)])
def test_pieces_make_the_product(kind: type, stack: tuple[int, ...], monkeypatch):
    """Pieces of 1 to 40 rows of 40; each is no larger than BLAS leaves to one thread, where one row is not already."""
    rng = np.random.default_rng(1)
    left = rng.standard_normal((*stack, 40, 7)).astype(kind)
    right = rng.standard_normal((7, 5)).astype(kind)
    expected = np.einsum("...ij,jk->...ik", left, right)
    for most in (1, 280, 1000, 1 << 20):
        monkeypatch.setattr(threads, "SHARED_OUT", most)
        found = product_on_one_core(left, right)
        assert found.dtype == kind and found.shape == expected.shape
        np.testing.assert_allclose(found, expected, atol=1e-5)
