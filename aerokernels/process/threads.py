"""Run work in several threads: NumPy, SciPy and Warp's kernels release Python's lock while they compute."""

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextvars import ContextVar
from typing import TypeVar

import numpy as np

from .machine import core_count
from .opened import OPENED

T = TypeVar("T")
R = TypeVar("R")

# Cores that the current thread may use for a part of its work; None for all that this process may use.
_share: ContextVar[int | None] = ContextVar("share", default=None)
# Threads that copy large arrays, which stay because to start them takes as long as to copy some megabytes; bytes that
# each copies at a time.
COPYING, COPIERS, PIECE = "aerokernels copies", 8, 1 << 21  # speed only


def copy_over(into: np.ndarray, values: np.ndarray) -> None:
    """Copy an array over another one of the same shape and type, both contiguous; large ones by several threads."""
    into, values = into.reshape(-1), values.reshape(-1)
    rows = max(1, PIECE // into.itemsize)
    copiers = min(COPIERS, core_count(), -(-len(into) // rows))
    if copiers < 2:
        np.copyto(into, values)
        return
    pool = OPENED.once((COPYING, os.getpid()), lambda: ThreadPoolExecutor(COPIERS, thread_name_prefix=COPYING))
    pieces = [slice(first, first + rows) for first in range(0, len(into), rows)]
    list(pool.map(lambda piece: np.copyto(into[piece], values[piece]), pieces))


def thread_count() -> int:
    """Number of threads of this process that may start work, besides those that only copy."""
    return sum(not thread.name.startswith(COPYING) for thread in threading.enumerate())


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
