"""Work on many things of which few are there at a time, some threads at it, its results in the things' own order."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def in_turn(work: Callable[[T], R], things: Iterable[T], threads: int) -> Iterator[R]:
    """What `work` gives for each thing; it is raised in its turn if that is an error, and nothing follows it.

    A thing is taken when a thread is free for it, so that no more than `threads` of them, or of results that nobody
    has asked for, are held. With one thread nothing is done before it is asked for.
    """
    if threads < 2:
        yield from map(work, things)
        return
    begun: deque[Future[R]] = deque()
    with ThreadPoolExecutor(threads) as pool:
        try:
            for thing in things:
                begun.append(pool.submit(work, thing))
                if len(begun) == threads:
                    yield begun.popleft().result()
            while begun:
                yield begun.popleft().result()
        finally:
            for one in begun:
                one.cancel()
