"""Stress-test recording: run each part, compare the outcome with what must come out, and report all in one table.

Exit status 0 if every part succeeds. The numbers are those of this machine; docs/hardware-measured.md shows some.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from scripts.studies.report import markdown_table
from tests.recording import faults, load
from tests.recording.line import Outcome

PARTS: dict[str, tuple[Callable[[Path, float], Outcome], float, float]] = {
    # name: its function, its size in full and in quick runs
    "damage": (faults.damage, 100_000, 4_000),
    "fuzz": (faults.fuzz, 20_000, 300),
    "kills": (faults.kills, 20, 1),
    "unplugs": (faults.unplugs, 20, 1),
    "throughput": (load.throughput, 60.0, 1.0),
    "long": (load.long, 8 * 3600.0, 120.0),
}


def main() -> int:
    """Run the requested parts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="small sizes: does it run at all?")
    parser.add_argument("--only", nargs="+", choices=tuple(PARTS), default=tuple(PARTS), help="parts to run")
    parser.add_argument("--out", type=Path, help="folder for table.md [default: print only]")
    arguments = parser.parse_args()
    if sys.platform == "win32":
        parser.error("pseudo-terminals are not there on Windows: run this on Linux or macOS")
    rows, good = [], True
    for name in arguments.only:
        run, full, quick = PARTS[name]
        start = time.perf_counter()
        with tempfile.TemporaryDirectory(prefix="hardware-soak-") as folder:
            outcome = run(Path(folder), quick if arguments.quick else full)
        good &= outcome.good
        rows.append((name, "ok" if outcome.good else "FAILED", outcome.text, f"{time.perf_counter() - start:.0f} s"))
        print(f"{name}: {rows[-1][1]}: {outcome.text}", flush=True)
    table = markdown_table(("part", "", "outcome", "took"), rows, text_columns=4)
    print(table)
    if arguments.out:
        arguments.out.mkdir(parents=True, exist_ok=True)
        (arguments.out / "table.md").write_text(table, encoding="utf-8")
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
