"""Run work in several threads: NumPy, SciPy and Warp's kernels release Python's lock while they compute."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from .machine import core_count

T = TypeVar("T")
R = TypeVar("R")


def in_threads(work: Callable[[T], None], pieces: Sequence[T]) -> None:
    """Process each piece, on all cores that this process may use; no two pieces may write to the same memory."""
    threads = min(core_count(), len(pieces))
    if threads < 2:
        for piece in pieces:
            work(piece)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, pieces))


def in_turn(work: Callable[[T], R], things: Iterable[T], threads: int) -> Iterator[R]:
    """Yield `work(thing)` for each thing, in order; an error is raised in its turn, and nothing follows it.

    A thing is taken when a thread is free for it, so that at most `threads` things or unread results exist at a time.
    With one thread each result is computed when it is requested.
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
