"""Gaps of a store: the numbers that a recording missed and that no other recorder of the same port stored meanwhile.

Each recording notes the numbers that are missing between its own echoes. Where a port was open in two recorders at a
time, each missed what the other one stored; which numbers the store lacks is found when it is read.
"""

from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from operator import index

from .rows import Gap

Rows = Callable[[str, tuple], Iterator[tuple]]

# Recordings that began before an earlier one of the same port had ended, or ended after a later one began.
_SHARED = (
    "SELECT id, port, protocol FROM (SELECT *, max(committed_ns) OVER (earlier ROWS BETWEEN UNBOUNDED PRECEDING AND 1 "
    "PRECEDING) AS until, lead(started_ns) OVER earlier AS next FROM recordings WHERE committed_ns NOT NULL "
    "WINDOW earlier AS (PARTITION BY port, protocol ORDER BY started_ns, id)) "
    "WHERE started_ns <= until OR committed_ns >= next"
)
_STORED = (
    "SELECT DISTINCT sequence FROM echoes WHERE session = ? AND recording IN "
    "(SELECT id FROM recordings WHERE port = ? AND protocol = ?) AND "
)


def shared_recordings(rows: Rows) -> dict[int, tuple]:
    """Return port and protocol of the recordings whose port another recorder had open too, by their numbers."""
    return {recording: tuple(origin) for recording, *origin in rows(_SHARED, ())}


def missing_in_store(rows: Rows, noted: Iterable[tuple[int, Gap]]) -> list[Gap]:
    """Return the parts of noted gaps of which no recording has stored anything, in their order.

    Args:
        rows: runs a query on the store.
        noted: gaps, each with the recording that noted it.
    """
    shared = shared_recordings(rows)
    missing, seen = [], set()
    for recording, gap in noted:
        if recording not in shared:
            missing.append(gap)
            continue
        first, last = gap.after_sequence, gap.before_sequence
        within = "sequence > ? AND sequence < ?" if first < last else "(sequence > ? OR sequence < ?)"
        found = rows(_STORED + within, (gap.session, *shared[recording], first, last))
        ends = sorted({0, (last - first) % 2**32, *((index(number) - first) % 2**32 for (number,) in found)})
        for low, high in pairwise(ends):
            part = Gap(gap.session, (first + low) % 2**32, (first + high) % 2**32, high - low - 1)
            if part.missing_count and (*shared[recording], part) not in seen:  # both recordings may have missed it
                seen.add((*shared[recording], part))
                missing.append(part)
    return missing
