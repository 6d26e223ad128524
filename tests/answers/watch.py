"""Collect the numbers that functions of the numerical core return to functions of other modules.

A module's answers to the others are its plans, bounds, errors and tables, whatever functions of its own they come
from. Python's profiler reports every return. For each function the returned numbers of all calls are summed by their
place in the result, with a weight for each place in an array, so that neither the order of the calls nor the threads
of a machine change the sums.
"""

import dataclasses
import os
import sys
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
CORE = tomllib.loads((ROOT / "scripts" / "mutated_modules.toml").read_text(encoding="utf-8"))["modules"]
MODULES = {str(ROOT / "aerokernels" / module): module.removesuffix(".py") for module in CORE}
# Results of other kinds inside results are followed this far; what is in more places than this is summed together.
DEPTH, PLACES = 4, 40
MEASURED = ("seconds", "stages")  # times that a machine took
ONCE = ("tracing/result: output_mask",)  # called where a kernel is built, once in a process
GENERATOR = 0x20 | 0x80 | 0x200  # flags of code whose frames return more than once
NUMBERS = "biufc"


@dataclasses.dataclass
class Sum:
    """Numbers of one place in the results of a function: how many, their weighted sum, and that of their sizes."""

    count: int = 0
    value: float = 0.0
    size: float = 0.0


Answers = dict[str, dict[str, Sum]]


class Watch:
    """Sums of what functions of the core return; an object of this class is a profile function."""

    def __init__(self, stages: tuple[str, ...]) -> None:
        self.found: Answers = {}
        self._stages = stages
        self._names: dict[int, str] = {}
        self._held: dict[int, Any] = {}  # what has a name by its address, or was summed, must not be freed
        self._weights = np.zeros(0)

    def __call__(self, frame, event: str, answer: Any) -> None:
        if event != "return":
            return
        code = frame.f_code
        name = self._names.get(id(code))
        if name is None:
            name = self._names[id(code)] = _name_of(code, self._stages)
            self._held[id(code)] = code
        if not name or frame.f_back is None or frame.f_back.f_code.co_filename == code.co_filename:
            return
        self.add(name, answer)

    def add(self, name: str, answer: Any) -> None:
        """Add an answer to the sums of a function."""
        sums = self.found.setdefault(name, {})
        sums.setdefault("calls", Sum()).count += 1
        for place, numbers in self._numbers(answer, "", DEPTH):
            if place not in sums and len(sums) >= PLACES:
                place = "others"
            self._add(sums.setdefault(place, Sum()), numbers)

    def _add(self, sum_: Sum, numbers: np.ndarray) -> None:
        if len(self._weights) < numbers.size:
            self._weights = 1.0 + 0.5 * np.sin(1.7 * np.arange(2 * numbers.size))
        finite = np.isfinite(numbers)
        kept = np.where(finite, numbers, 0.0)
        weights = self._weights[: numbers.size]
        sum_.count += int(np.count_nonzero(finite))
        sum_.value += float(weights @ kept)
        sum_.size += float(weights @ np.abs(kept))

    def _numbers(self, value: Any, place: str, depth: int) -> Iterator[tuple[str, np.ndarray]]:
        """Yield the numbers in a result by their place: fields of objects, entries of tuples, keys of dictionaries.

        An object is summed once, at the first function that returns it.
        """
        if isinstance(value, (bool, int, float, complex, np.generic)):
            value = np.asarray(value)
        if isinstance(value, np.ndarray):
            if value.dtype.kind in NUMBERS and value.size:
                flat = value.ravel()
                yield place, (flat.view(flat.real.dtype) if value.dtype.kind == "c" else flat).astype(float)
            return
        if depth == 0:
            return
        if isinstance(value, dict):
            parts = [(str(key), one) for key, one in value.items() if isinstance(key, (str, int))]
        elif isinstance(value, (tuple, list)):
            names = getattr(value, "_fields", None) or range(len(value))
            parts = [(str(name), one) for name, one in zip(names, value, strict=True)]
        elif dataclasses.is_dataclass(value) and not isinstance(value, type) and id(value) not in self._held:
            self._held[id(value)] = value
            parts = [(one.name, getattr(value, one.name, None)) for one in dataclasses.fields(value)]
        else:
            return
        for name, one in parts:
            if name in MEASURED:
                continue
            yield from self._numbers(one, f"{place}.{name}", depth - 1)


def _name_of(code, stages: tuple[str, ...]) -> str:
    module = MODULES.get(code.co_filename)
    if (
        module is None
        or not module.startswith(stages)
        or code.co_flags & GENERATOR
        or "<" in code.co_qualname.replace("<locals>", "")
    ):
        return ""
    name = f"{module}: {code.co_qualname.replace('.<locals>', '')}"
    return "" if name in ONCE else name


def watched(run: Callable[[], Any], stages: tuple[str, ...]) -> Answers:
    """Return what functions of some stages answer while `run()` runs, in one thread, and what `run` itself returns."""
    watch = Watch(stages)
    with _one_core():
        before = sys.getprofile()
        sys.setprofile(watch)
        try:
            answer = run()
        finally:
            sys.setprofile(before)
    watch.add("case", answer)
    return watch.found


@contextmanager
def _one_core() -> Iterator[None]:
    """Let the package find one core: what it computes in threads is then computed here, in order."""
    with mock.patch.object(os, "sched_getaffinity", lambda _: {0}, create=True):
        yield
