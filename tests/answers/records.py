"""Compare what functions answer with a record in a file, and write the record.

A number is written with as many digits as hold on any machine: when a record is written its case is run again with
inputs that are changed by some rounding errors, and digits that differ are left out. A number fits if it is within one
unit of its last digit. `count x` says how many finite numbers were summed where it is not one for each call.
"""

import json
import math
from pathlib import Path

import numpy as np

from .watch import Answers, Sum

# Relative change of inputs, how often a case is run with it, and the times by which other machines may differ more.
NUDGE, TRIES, MARGIN = 1e-13, 3, 10.0
# Tolerance of a sum over the sum of sizes: at least the first, and ROUNDINGS times the change of inputs, which is
# larger where kernels compute in single precision. A sum whose tolerance is above the second is left out.
LEAST, MOST, ROUNDINGS = 1e-9, 1e-2, 10.0

RECORDS = Path(__file__).parent / "records"

Record = dict[str, dict[str, str]]


class Nudge:
    """Changes inputs by some rounding errors; the plain one leaves them as they are."""

    def __init__(self, size: float = 0.0, seed: int = 0):
        self.size, self.random = size, np.random.default_rng([seed, 77])

    def __call__(self, values):
        """Return values, an array or a number, with relative changes."""
        if not self.size:
            return values
        values = np.asarray(values, dtype=float)
        found = values * (1.0 + self.size * self.random.uniform(-1.0, 1.0, values.shape))
        return found if found.ndim else float(found)


def written(plain: Answers, others: list[Answers], nudge: float) -> Record:
    """Return the record of a case from its answers, and from those to inputs that were changed by `nudge`."""
    least = max(LEAST, ROUNDINGS * nudge)
    record: Record = {}
    for name, sums in sorted(plain.items()):
        lines = {}
        for place, one in sums.items():
            alike = [other.get(name, {}).get(place) for other in others]
            if place == "calls":
                lines[place] = str(one.count) if all(each == one for each in alike) else "some"
            elif all(each is not None and each.count == one.count for each in alike):
                spread = max((abs(each.value - one.value) for each in alike if each is not None), default=0.0)
                # Kernels in single precision on another machine may take another step or two.
                is_exact = nudge < LEAST or one.count == sums["calls"].count
                if text := _number(one, max(least * one.size, MARGIN * spread), is_exact and not spread):
                    counted = "" if one.count == sums["calls"].count else f"{one.count} x "
                    lines[place] = counted + text
        if lines != {"calls": "some"}:
            record[name] = lines
    return record


def _number(one: Sum, tolerance: float, is_exact: bool) -> str:
    """Return a sum with the digits that hold; empty if none does."""
    if not math.isfinite(one.value) or tolerance > MOST * one.size:
        return ""
    if one.size == 0.0:
        return "0"
    unit = math.ceil(math.log10(tolerance))
    if one.value == round(one.value) and abs(one.value) < 1e9 and is_exact:
        return str(round(one.value))
    digits = max(0, math.floor(math.log10(max(abs(one.value), 10.0**unit))) - unit)
    return f"{one.value:.{digits}e}" if abs(one.value) >= 10.0**unit else f"0e{unit}"


def differences(record: Record, found: Answers) -> list[str]:
    """Return in words what does not fit the record."""
    lines = []
    for name, places in record.items():
        sums = found.get(name)
        if sums is None:
            lines.append(f"{name}: not called")
            continue
        for place, text in places.items():
            one = sums.get(place, Sum())
            if place == "calls":
                if text != "some" and text != str(one.count):
                    lines.append(f"{name}: {one.count} calls, {text} recorded")
            elif not _fits(text, one, sums["calls"].count):
                lines.append(f"{name} {place}: {one.count} x {one.value:.10g}, {text} recorded")
    return lines


def _fits(text: str, one: Sum, calls: int) -> bool:
    """Whether a sum has the recorded count, and is within a unit of the recorded number's last digit."""
    counted, _, number = text.rpartition(" x ")
    if one.count != int(counted or calls):
        return False
    head, _, power = number.partition("e")
    unit = 10.0 ** (int(power) - len(head.partition(".")[2])) if power else LEAST * max(abs(float(head)), one.size)
    return abs(one.value - float(number)) <= unit


def read(path: Path) -> dict[str, Record]:
    """Return the records in a file, by case; none if there is no file."""
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def write(path: Path, records: dict[str, Record]) -> None:
    """Write the records of cases to a file, a line for each function."""
    cases = []
    for name, record in sorted(records.items()):
        lines = [f"  {json.dumps(function)}: {json.dumps(places)}" for function, places in sorted(record.items())]
        cases.append(f"{json.dumps(name)}: {{\n" + ",\n".join(lines) + "\n}")
    path.write_text("{\n" + ",\n".join(cases) + "\n}\n", encoding="utf-8")


def changed(before: Record, after: Record) -> list[str]:
    """Return in words how a record differs from the one before it."""
    lines = []
    for name in sorted({*before, *after}):
        old, new = before.get(name, {}), after.get(name, {})
        for place in dict.fromkeys([*old, *new]):
            if old.get(place) != new.get(place):
                lines.append(f"{name} {place}: {old.get(place, 'none')} -> {new.get(place, 'none')}")
    return lines
