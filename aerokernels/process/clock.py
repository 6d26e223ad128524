"""Measure the wall time of a computation by stage, each moment counted once, and its processor time in total.

A stage that begins within another one interrupts it: a kernel compiled while a plan is made counts as "compile". Times
are the host's; a launch ends when the device is done. The entries of a mapping of seconds (STAGES) therefore add up to
at most its "total", the wall time of the whole call; the rest is Python between the stages.
"""

import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
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
_processor: ContextVar[list[float] | None] = ContextVar("processor", default=None)


@contextmanager
def clocked() -> Iterator[dict[str, float]]:
    """Measure the seconds of every stage in this block, inner blocks included, and at its end their "total"."""
    seconds = dict.fromkeys(("plan", "upload", "compile", "kernel", "download"), 0.0)
    begin, running = time.perf_counter(), _running.get()
    token = _running.set((*running, seconds))
    try:
        yield seconds
    finally:
        _running.reset(token)
        seconds["total"] = time.perf_counter() - begin


@contextmanager
def processor_clocked() -> Iterator[list[float]]:
    """Measure the processor seconds of all threads and all stages in this block, as one growing number."""
    seconds = [0.0]
    token = _processor.set(seconds)
    try:
        yield seconds
    finally:
        _processor.reset(token)


@contextmanager
def stage(name: str) -> Iterator[None]:
    """Count this block as the named stage, except for the stages within it."""
    begin, outer, within = time.perf_counter(), _within.get(), [0.0]
    processor = _processor.get() if outer is None else None
    busy = 0.0 if processor is None else time.process_time()
    token = _within.set(within)
    try:
        yield
    finally:
        _within.reset(token)
        if processor is not None:
            processor[0] += time.process_time() - busy
        spent = time.perf_counter() - begin
        for seconds in _running.get():
            seconds[name] = seconds.get(name, 0.0) + max(spent - within[0], 0.0)
        if outer is not None:
            outer[0] += spent


def staged(name: str, items: Iterable[T]) -> Iterator[T]:
    """Yield the items; the time that it takes to find each counts as the named stage."""
    rest = iter(items)
    while True:
        with stage(name):
            try:
                item = next(rest)
            except StopIteration:
                return
        yield item
