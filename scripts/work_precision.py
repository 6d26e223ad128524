"""Measure error against run time and field evaluations, for methods, precisions, interpolants and tolerances.

The six fields and the two kinds of error are those of scripts/studies/work_precision. Writes runs.csv, one row
per setting; table.md; and for each field two pictures, error against evaluations and against time.
"""

import argparse
import time
from pathlib import Path

from scripts.studies.report import filled, write_csv
from scripts.studies.work_precision.fields import CASES
from scripts.studies.work_precision.figures import draw, evaluations
from scripts.studies.work_precision.measuring import measure, measure_peers
from scripts.studies.work_precision.runs import HEADING, Error, Run
from scripts.studies.work_precision.tables import (
    check_table,
    default_table,
    need_table,
    peer_table,
    report_table,
)

ROOT = Path(__file__).resolve().parents[1]
QUICK_FIELDS = ("radial", "shock")


def say(text: str) -> None:
    """Print progress at once."""
    print(text, flush=True)


def main() -> None:
    """Measure, and write CSV, tables and pictures."""
    parser = argparse.ArgumentParser(prog="scripts/work_precision", description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "accuracy")
    parser.add_argument("--page", type=Path, help="a page to put the tables into, between its marks")
    parser.add_argument("--fields", nargs="+", choices=CASES, help="some of the fields only")
    parser.add_argument("--rays", type=int, default=256, metavar="COUNT", help="rays that errors are taken over")
    parser.add_argument(
        "--timed-rays", type=int, default=20_000, metavar="COUNT", help="rays of a timed launch, at most"
    )
    parser.add_argument("--repeats", type=int, default=5, metavar="COUNT", help="timed launches of each setting")
    parser.add_argument("--quick", action="store_true", help="a few settings and rays, to see that it works")
    options = parser.parse_args()
    for name in ("rays", "timed_rays", "repeats"):
        if getattr(options, name) < 1:
            parser.error(f"--{name.replace('_', '-')}: {getattr(options, name)} is too few, give at least 1")
    counts = (64, 512, 1) if options.quick else (options.rays, options.timed_rays, options.repeats)

    options.out.mkdir(parents=True, exist_ok=True)
    runs: list[Run] = []
    checks: dict[tuple[str, str], tuple[Error, Error]] = {}
    for name in options.fields or (QUICK_FIELDS if options.quick else CASES):
        start = time.perf_counter()
        case = CASES[name]()
        say(f"{name}: {case.title}")
        some, confirmed = measure(case, *counts, options.quick, say)
        runs += some
        checks |= confirmed
        draw(some, case.title, "field evaluations per ray", evaluations, options.out / f"{name}_evaluations.png")
        draw(some, case.title, "kernel time per ray [µs]", Run.microseconds, options.out / f"{name}_time.png")
        say(f"  {len(some)} settings in {time.perf_counter() - start:.0f} s")
    write_csv(options.out / "runs.csv", HEADING, [run.row() for run in runs])

    tables = {
        "evaluations": need_table(runs),
        "default": default_table(runs),
        "reported": report_table(runs),
    }
    if not options.quick:
        tables["peers"] = peer_table(measure_peers(options.rays))
    captions = {
        "evaluations": "Field evaluations per ray for an rms tracing error [waves]",
        "default": "The default call: method auto, tolerance 1e-3 waves, float32; errors in waves",
        "reported": "Reported against made, over all runs",
        "peers": "Beside others' best: greatest total errors",
        "checks": "The tight traces against two others [waves]",
    }
    shown = tables if options.quick else {**tables, "checks": check_table(checks)}  # checks are for table.md alone
    text = "\n".join(f"## {captions[name]}\n\n{table}" for name, table in shown.items())
    (options.out / "table.md").write_text(text, encoding="utf-8")
    if options.page is not None:
        try:
            options.page.write_text(filled(options.page, tables), encoding="utf-8")
        except ValueError as fault:
            parser.error(f"--page: {fault}")
    say(f"\n{text}\nwrote {options.out}/table.md, runs.csv and two pictures for each field")


if __name__ == "__main__":
    main()
