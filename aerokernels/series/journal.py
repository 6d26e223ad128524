"""The journal beside a store of maps: a line with what defines the run, then one for each finished snapshot.

The line of a snapshot has its numbers, and where its series reads files the stamp of these files and the mark of the
samples (`Series.is_unchanged`). A kill leaves half a line at the end at most.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

from aerokernels.display.plain_text import cut

# Keys of a definition: hashes of samples. Runs from one initial flow differ in their last snapshots.
FIRST, LAST = "first snapshot", "last snapshot"


class DamagedError(ValueError):
    """A journal is damaged."""


class OtherSeriesError(ValueError):
    """A journal belongs to another series; the message says in which way."""


@dataclass(frozen=True)
class Kept:
    """What a journal contains of a run.

    Attributes:
        rows: The numbers of the snapshots that are finished and unchanged, in their order.
        size: Bytes of the journal up to the end of their lines.
        whole: Bytes of the journal up to the end of its last whole line.
        changed_count: Number of finished snapshots that are not among them: files of the first one have changed.
        has_grown: Whether the series has more snapshots than it had.
    """

    rows: list[dict[str, float]]
    size: int
    whole: int
    changed_count: int
    has_grown: bool


def line_of(numbers: Sequence[float], source: Sequence[str]) -> bytes:
    """Return the line of a snapshot: its numbers, and stamp and mark of its files or nothing."""
    return (json.dumps([*numbers, list(source)] if source else list(numbers)) + "\n").encode()


def read_journal(
    data: bytes,
    definition: Mapping[str, Any],
    names: Sequence[str],
    is_unchanged: Callable[[int, str, str], bool],
    earlier: Callable[[Mapping[str, Any]], Mapping[str, Any] | None],
) -> Kept:
    """Read the journal of a run.

    Args:
        data: Its bytes.
        definition: What distinguishes this run from others.
        names: The names of the numbers of a snapshot.
        is_unchanged: Whether a snapshot is the one that was stored with this stamp and this mark.
        earlier: Returns the definition of the same run with as many snapshots as in the definition found; None if it
            has fewer.

    Raises:
        DamagedError: It is no journal.
        OtherSeriesError: It is that of another run.
    """
    whole = data.rfind(b"\n") + 1
    first, *lines = data[:whole].splitlines(keepends=True) or [b"null"]
    try:
        found = json.loads(first)
    except (RecursionError, ValueError):
        raise DamagedError from None
    if not isinstance(found, (dict, type(None))):
        raise DamagedError
    found = found or {}
    has_grown = found != definition and found == earlier(found)
    if not has_grown and (change := _change(found, definition)):
        raise OtherSeriesError(change)
    read = [_row(line, names) for line in lines]
    count = next((k for k, (_, source) in enumerate(read) if source and not is_unchanged(k, *source)), len(read))
    size = len(first) + sum(map(len, lines[:count]))
    return Kept([numbers for numbers, _ in read[:count]], size, whole, len(read) - count, has_grown)


def _row(line: bytes, names: Sequence[str]) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return the numbers of a snapshot, and stamp and mark of its files or nothing."""
    try:
        *row, last = json.loads(line)
        source = tuple(map(str, last)) if isinstance(last, list) else ()
        numbers = dict(zip(names, map(float, row if source else [*row, last]), strict=True))
    except (ArithmeticError, RecursionError, TypeError, ValueError):
        raise DamagedError from None
    if len(source) not in (0, 2):
        raise DamagedError
    return numbers, source


def _change(old: Any, new: Any, key: str = "") -> str:
    """Return the first difference of two definitions in words; empty if they are equal."""
    if old == new:
        return ""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        name = next(name for name in (*old, *new) if old.get(name) != new.get(name))
        inner = name if not key or name not in (*old, *new) else f"{key} {name}"
        if name in (FIRST, LAST) and name in old and name in new:
            return f"whose {name} has other densities"
        return _change(old.get(name), new.get(name), inner)
    if isinstance(old, list) and isinstance(new, list) and max(len(old), len(new)) > 3:
        count = "" if len(old) == len(new) else f" has {len(new)} instead of {len(old)} entries, and"
        place = next(k for k, (one, other) in enumerate(zip_longest(old, new, fillvalue=zip_longest)) if one != other)
        was, now = (_short(one[place]) if place < len(one) else "absent" for one in (old, new))
        return f"whose {key}{count} was {was} and is {now} at number {place}"
    return f"{key} was {_short(old)} and is {_short(new)}"


def _short(value: Any) -> str:
    return cut(json.dumps(value))
