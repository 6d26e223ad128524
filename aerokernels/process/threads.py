"""Work by some threads at a time: NumPy, SciPy and Warp's kernels release Python's lock where they compute."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from .machine import core_count

T = TypeVar("T")
R = TypeVar("R")


def in_threads(work: Callable[[T], None], pieces: Sequence[T]) -> None:
    """Do the work of each piece, on all cores that this process may use; no two pieces may write to one place."""
    threads = min(core_count(), len(pieces))
    if threads < 2:
        for piece in pieces:
            work(piece)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, pieces))


def in_turn(work: Callable[[T], R], things: Iterable[T], threads: int) -> Iterator[R]:
    """What `work` gives for each thing, in their order; an error is raised in its turn, and nothing follows it.

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
