"""Order files by the numbers in their names, and find steps that are missing or there twice.

A number with a point may be a time or two counters: 0.05, 0.1, 0.15, or 1.9, 1.10, 1.11. Files of a run are written at
even steps, so the reading in which the numbers grow evenly is the right one; without one they are counters.
"""

import re
from collections.abc import Sequence
from fractions import Fraction
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

from aerokernels.inputs.checks import warn_caller

COUNTERS, DECIMALS = r"([0-9]+)", r"([0-9]+(?:\.[0-9]+)?)"
# Deviation of a step from the mean of all at which they are still even: times in names are rounded.
EVEN = 0.25
LEAST = 3  # files of which the steps can be compared


def in_order(paths: Sequence[Path]) -> list[Path]:
    """Return files ordered by the numbers in their names."""
    for reading in (COUNTERS, DECIMALS):
        ordered = sorted(paths, key=partial(_pieces, reading=reading))
        steps = _steps(ordered, reading)
        if len(steps) >= LEAST - 1 and _are_even(steps):
            return ordered
    return sorted(paths, key=partial(_pieces, reading=COUNTERS))


def warn_of_gaps(paths: Sequence[Path]) -> None:
    """Warn of files whose names have one number that differs, and not by even steps."""
    found = [_steps(paths, reading) for reading in (COUNTERS, DECIMALS)]
    if all(len(steps) >= LEAST - 1 and not _are_even(steps) for steps in found):
        usual = sorted(found[0])[len(found[0]) // 2]
        odd = next((k for k, step in enumerate(found[0]) if step != usual), 0)
        warn_caller(
            f"the files are not numbered evenly: {paths[odd + 1].name} comes after {paths[odd].name}. A snapshot may "
            "be missing, or there twice; time_step gives all of them even times: give time=, one for each"
        )


def _pieces(path: Path, reading: str) -> list[str | int | Fraction]:
    """Return the texts and the numbers of a name, in turn."""
    return [_number(one) if k % 2 else one for k, one in enumerate(re.split(reading, path.name))]


def _number(text: str) -> int | Fraction:
    return Fraction(text) if "." in text else int(text)


def _steps(paths: Sequence[Path], reading: str) -> list[float]:
    """Return the differences of the one number that differs from name to name; empty if several do, or none."""
    names = [_pieces(path, reading)[1::2] for path in paths]
    if len({len(name) for name in names}) != 1:
        return []
    columns: list[Any] = [column for column in zip(*names, strict=True) if len(set(column)) > 1]
    if len(columns) != 1:
        return []
    return [float(after - before) for before, after in pairwise(columns[0])]


def _are_even(steps: Sequence[float]) -> bool:
    mean = sum(steps) / len(steps)
    return mean > 0 and all(abs(step - mean) <= EVEN * mean for step in steps)
