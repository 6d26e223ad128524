"""Mixed runs in one process: readings of memory, handles and threads each minute, and their slopes at the end.

Exit status 0 when memory grows by less than 0.1 MiB a minute, beyond twice its standard error, in the second half, and
no handle or thread is left behind. Needs /proc, as Linux has it.
"""

import argparse
import csv
import os
import sys
from dataclasses import astuple, fields
from pathlib import Path

import numpy as np

from aerokernels.tracing import available_backends
from aerokernels.validation.report import markdown_table
from aerokernels.validation.soak import Reading, slope, soak

GREATEST_SLOPE = 0.1  # [MiB/min]: 144 MiB a day


def main() -> int:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=120.0, help="how long")
    parser.add_argument("--share", type=float, default=0.15, help="of one core, at most on average")
    parser.add_argument("--out", type=Path, help="folder for readings.csv and table.md [default: print only]")
    given = parser.parse_args()
    if not Path("/proc/self/status").exists():
        parser.error("there is no /proc here: run this on Linux")
    os.nice(19)
    there = {way.backend for way in available_backends() if way.available}
    backends = tuple(name for name in ("warp", "opencl") if name in there)
    readings: list[Reading] = []
    counts: dict[str, int] = {}
    for found, counted in soak(given.minutes, given.share, backends):
        counts = counted
        readings.append(found)
        print(f"{found.minute:6.1f} min, {found.runs} runs: {found.memory:.1f} MiB, {found.handles} handles, "
              f"{found.threads} threads", flush=True)  # fmt: skip
    table = np.array([astuple(one) for one in readings])
    late = table[len(table) // 2 :]
    rows, good = [], True
    for name, column, unit in (("memory", 2, "MiB"), ("handles", 3, ""), ("threads", 4, "")):
        rise, error = slope(late[:, 0], late[:, column])
        if column == 2:
            fine = not rise - 2.0 * error > GREATEST_SLOPE
        else:
            fine = late[-1, column] <= late[:, column].min() + 1
        fine = bool(fine)
        good &= fine
        ends = (f"{value:.1f} {unit}".strip() for value in (table[0, column], late[0, column], late[-1, column]))
        rows.append(
            (name, *ends, f"{rise:+.3f} +- {error:.3f} {unit}/min".replace(" /", " 1/"), "flat" * fine or "GROWS")
        )
    text = markdown_table(("", "first", "at half time", "last", "slope of the second half", ""), rows, text_columns=6)
    ran = ", ".join(f"{name} {count}" for name, count in counts.items())
    print(text + f"\n{readings[-1].runs} runs in {readings[-1].minute:.0f} min: {ran}")
    if given.out:
        given.out.mkdir(parents=True, exist_ok=True)
        (given.out / "table.md").write_text(text, encoding="utf-8")
        with (given.out / "readings.csv").open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([[field.name for field in fields(Reading)], *map(astuple, readings)])
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
