"""Measure the wall time of a computation by stage, each moment counted once.

A stage that begins within another one interrupts it: a kernel compiled while a plan is made counts as "compile". Times
are the host's; a launch ends when the device is done. The entries of a mapping of seconds (STAGES) therefore add up to
at most its "total", the wall time of the whole call; the rest is Python between the stages.
"""

import time
from collections.abc import Iterable, Iterator
from contextvars import ContextVar
from typing import TypeVar

T = TypeVar("T")

# Meaning of the entries of a mapping `seconds`.
STAGES = {
    "plan": "checks, and choosing how to trace, the tables for that included",
    "upload": "fields and rays to the device",
    "compile": "building kernels",
    "kernel": "launches, from the first to the end of the last, without copies that the host makes between them",
    "download": "results to the host",
    "landing": "of a picture: where the rays of its pixels land, the field's edge included",
    "spread": "of a picture: the point spread functions of its nodes",
    "render": "of a picture: the scene, displaced and spread",
    "error": "the error budget, once it has been asked for; not part of the total of a trace or an estimate",
    "total": "wall time of the call",
}

# The running clocks, and for the open stage the time that stages within it took.
_running: ContextVar[tuple[dict[str, float], ...]] = ContextVar("running", default=())
_within: ContextVar[list[float] | None] = ContextVar("within", default=None)


class clocked:
    """Measure the seconds of every stage in this block, inner blocks included, and at its end their "total"."""

    __slots__ = ("_begin", "_token", "seconds")

    def __enter__(self) -> dict[str, float]:
        """Start the clock; return its growing seconds by stage."""
        self.seconds = {"plan": 0.0, "upload": 0.0, "compile": 0.0, "kernel": 0.0, "download": 0.0}
        self._begin = time.perf_counter()
        self._token = _running.set((*_running.get(), self.seconds))
        return self.seconds

    def __exit__(self, *_: object) -> None:
        """Stop the clock."""
        _running.reset(self._token)
        self.seconds["total"] = time.perf_counter() - self._begin


class stage:
    """Count a block as the named stage, except for the stages within it.

    A class, since entering a generator takes several times as long, and a ratio has some twenty stages.
    """

    __slots__ = ("_begin", "_outer", "_token", "_within", "name")

    def __init__(self, name: str):
        """Take the stage's name."""
        self.name = name

    def __enter__(self) -> None:
        """Start the stage's clock."""
        self._begin, self._outer, self._within = time.perf_counter(), _within.get(), [0.0]
        self._token = _within.set(self._within)

    def __exit__(self, *_: object) -> None:
        """Add the stage's time to every running clock."""
        _within.reset(self._token)
        spent = time.perf_counter() - self._begin
        for seconds in _running.get():
            seconds[self.name] = seconds.get(self.name, 0.0) + max(spent - self._within[0], 0.0)
        if self._outer is not None:
            self._outer[0] += spent


def staged(name: str, items: Iterable[T]) -> Iterator[T]:
    """Yield the items; the time that it takes to find each counts as the named stage."""
    source = iter(items)
    while True:
        with stage(name):
            try:
                item = next(source)
            except StopIteration:
                return
        yield item
