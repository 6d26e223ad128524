"""Run work in several threads: NumPy, SciPy and Warp's kernels release Python's lock while they compute."""

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextvars import ContextVar
from typing import TypeVar

import numpy as np

from aerokernels.process.machine import core_count
from aerokernels.process.opened import OPENED

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
    threads = 1 if len(pieces) < 2 else min(own_cores(), len(pieces))
    if threads < 2:
        for piece in pieces:
            work(piece)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, pieces))


def slabs(count: int, size: int, step: int = 1) -> list[slice]:
    """Divide `count` rows, in all `size` numbers, for `in_threads`, by whole steps: what is made of them is small."""
    most = LEAST_SLAB if SHARE * size <= LEAST_SLAB else min(SLAB, max(LEAST_SLAB, int(SHARE * size) // own_cores()))
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


# Name and number of the threads, bytes that each takes at a time, and the least number of cores for which they pay.
COPIERS, THREADS, PIECE, LEAST_CORES = "aerokernels arrays", 8, 1 << 21, 4  # speed only


def copy_over(into: np.ndarray, values: np.ndarray) -> None:
    """Copy an array over another one of the same shape, with a conversion to its type."""

    def copy(rows: slice) -> None:
        into[rows] = values[rows]

    _by_rows(copy, into)


def copy_and_scan(into: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """`copy_over`, and `extremes_of` the copy, of which each piece is scanned while it is in a core's cache."""

    def copy(rows: slice) -> tuple[float, float]:
        into[rows] = values[rows]
        return into[rows].min(), into[rows].max()

    return _extremes(_by_rows(copy, into))


def extremes_of(values: np.ndarray) -> tuple[float, float]:
    """Return the least and the greatest entry; both are NaN if any entry is."""
    return _extremes(_by_rows(lambda rows: (values[rows].min(), values[rows].max()), values))


def _extremes(parts: list[tuple[float, float]]) -> tuple[float, float]:
    """Those of all parts, NaN if those of one are."""
    found = np.array(parts)
    return float(found[:, 0].min()), float(found[:, 1].max())


def thread_count() -> int:
    """Number of threads of this process that may start work, without those that only copy and scan."""
    return sum(not thread.name.startswith(COPIERS) for thread in threading.enumerate())


def _by_rows(work: Callable[[slice], R], array: np.ndarray) -> list[R]:
    """Return the results of work on all rows of an array, piece by piece, in order."""
    rows = max(1, PIECE * len(array) // max(array.nbytes, 1))
    if rows >= len(array):
        return [work(slice(None))]
    pieces = [slice(first, first + rows) for first in range(0, len(array), rows)]
    if own_cores() < LEAST_CORES:
        return [work(piece) for piece in pieces]
    # A forked child has none of the threads.
    pool = OPENED.once((COPIERS, os.getpid()), lambda: ThreadPoolExecutor(min(THREADS, own_cores()), COPIERS))
    return list(pool.map(work, pieces))


# Multiplications in a product of real matrices up to which OpenBLAS uses one thread; an eighth of it for complex ones.
SHARED_OUT = 1 << 18  # speed only


def product_on_one_core(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Multiply stacks of matrices (..., rows, n) and (..., n, columns) in pieces that BLAS does not divide."""
    rows, inner, columns = left.shape[-2], left.shape[-1], right.shape[-1]
    most = SHARED_OUT // 8 if "c" in (left.dtype.kind, right.dtype.kind) else SHARED_OUT
    step = max(1, most // max(inner * columns, 1))  # speed only
    if rows <= step:
        return np.asarray(left @ right)
    stack = np.broadcast_shapes(left.shape[:-2], right.shape[:-2])
    found = np.empty((*stack, rows, columns), dtype=np.result_type(left, right))
    for first in range(0, rows, step):
        np.matmul(left[..., first : first + step, :], right, out=found[..., first : first + step, :])
    return found
