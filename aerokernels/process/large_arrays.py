"""Copy and scan large arrays by several threads: one core reads a part of what memory gives.

The threads stay, because to start them takes as long as to copy some megabytes.
"""

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np

from .opened import OPENED
from .threads import own_cores

R = TypeVar("R")

# Name and number of the threads, bytes that each takes at a time, and the least number of cores for which they pay.
NAME, THREADS, PIECE, LEAST = "aerokernels arrays", 8, 1 << 21, 4  # speed only


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
    return sum(not thread.name.startswith(NAME) for thread in threading.enumerate())


def _by_rows(work: Callable[[slice], R], array: np.ndarray) -> list[R]:
    """Return the results of work on all rows of an array, piece by piece, in order."""
    rows = max(1, PIECE * len(array) // max(array.nbytes, 1))
    if rows >= len(array):
        return [work(slice(None))]
    pieces = [slice(first, first + rows) for first in range(0, len(array), rows)]
    if own_cores() < LEAST:
        return [work(piece) for piece in pieces]
    # A forked child has none of the threads.
    pool = OPENED.once((NAME, os.getpid()), lambda: ThreadPoolExecutor(min(THREADS, own_cores()), NAME))
    return list(pool.map(work, pieces))
