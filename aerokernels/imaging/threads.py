"""Pieces of a picture, each by a thread: NumPy and SciPy release Python's lock where they compute."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from ..machine import core_count

P = TypeVar("P")


def in_threads(work: Callable[[P], None], pieces: Sequence[P]) -> None:
    """Do the work of each piece, on all cores that this process may use; no two pieces may write to one place."""
    threads = min(core_count(), len(pieces))
    if threads < 2:
        for piece in pieces:
            work(piece)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, pieces))
