"""Run work in several threads: NumPy, SciPy and Warp's kernels release Python's lock while they compute."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextvars import ContextVar
from typing import TypeVar

from .machine import core_count

T = TypeVar("T")
R = TypeVar("R")

# Most and least numbers in a slab of an array, and share of the array that the slabs of all threads are at most.
SLAB, LEAST_SLAB, SHARE = 1 << 18, 1 << 14, 1 / 16

# Cores that the current thread may use for a part of its work; None for all that this process may use.
_share: ContextVar[int | None] = ContextVar("share", default=None)


def in_threads(work: Callable[[T], None], pieces: Sequence[T]) -> None:
    """Process each piece, on the cores that the calling thread may use; no two pieces may write to the same memory.

    These are all cores of this process, and in a thread of `in_turn` its share of them.
    """
    threads = min(own_cores(), len(pieces))
    if threads < 2:
        for piece in pieces:
            work(piece)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, pieces))


def slabs(count: int, size: int, step: int = 1) -> list[slice]:
    """Divide `count` rows, in all `size` numbers, for `in_threads`, by whole steps: what is made of them is small."""
    most = min(SLAB, max(LEAST_SLAB, int(SHARE * size) // own_cores()))
    rows = max(1, most * count // max(size * step, 1)) * step
    return [slice(first, min(first + rows, count)) for first in range(0, count, rows)]


def own_cores() -> int:
    """Number of cores that the calling thread may use."""
    share = _share.get()
    return core_count() if share is None else share


def in_turn(work: Callable[[T], R], things: Iterable[T], threads: int) -> Iterator[R]:
    """Yield `work(thing)` for each thing, in order; an error is raised in its turn, and nothing follows it.

    A thing is taken when a thread is free for it, so that at most `threads` things or unread results exist at a time.
    With one thread each result is computed when it is requested.
    """
    if threads < 2:
        yield from map(work, things)
        return
    begun: deque[Future[R]] = deque()
    share = max(1, core_count() // threads)  # threads of threads would take each other's cores
    with ThreadPoolExecutor(threads, initializer=lambda: _share.set(share)) as pool:
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
