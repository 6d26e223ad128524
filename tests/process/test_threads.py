"""Work in threads: results in order, and cores divided among threads that start threads themselves."""

import threading

import pytest

from aerokernels.process import threads


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
