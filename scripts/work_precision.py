"""Error against run time and field evaluations, for methods x precisions x interpolants x tolerances on five fields.

The fields are those of work_precision_fields.py, the two kinds of error those of work_precision_runs.py. Writes
runs.csv, one row for each setting; table.md; and for each field two pictures, error against evaluations and time.
"""

import argparse
import time
from pathlib import Path

from tables import write_csv
from work_precision_fields import CASES, Case, radial_parallel, sech
from work_precision_figures import draw, evaluations
from work_precision_runs import HEADING, INTERPOLATIONS, PRECISIONS, Bench, Error, Run, Setting, measure_times
from work_precision_tables import (
    TIGHTER,
    check_table,
    default_table,
    floor_table,
    need_table,
    peer_table,
    put_between_marks,
    report_table,
)

ROOT = Path(__file__).resolve().parents[1]
# From coarser than anyone wants, so that the loosest target lies inside every curve.
TOLERANCES = (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)  # [waves]
STEPS = (32.0, 16.0, 8.0, 4.0, 2.0, 1.0, 0.5, 0.25, 0.125)  # [cells]
SETTINGS = [
    *(Setting("adaptive", tolerance) for tolerance in TOLERANCES),
    *(Setting("fixed", step) for step in STEPS),
    Setting("paper"),
    *(Setting("straight", tolerance) for tolerance in TOLERANCES),
    *(Setting("auto", tolerance) for tolerance in TOLERANCES),
]
QUICK_SETTINGS = [
    *(Setting("adaptive", tolerance) for tolerance in (1e-1, 1e-3, 1e-5)),
    *(Setting("fixed", step) for step in (8.0, 2.0, 1.0)),
    Setting("auto", 1e-3),
]
QUICK_FIELDS = ("radial", "shock")
PEER_SETTINGS = [Setting("adaptive", tolerance) for tolerance in (1e-2, 1e-3)]


def say(text: str) -> None:
    """Progress, at once."""
    print(text, flush=True)


def measure(
    case: Case, ray_count: int, timed_count: int, repeats: int, quick: bool
) -> tuple[list[Run], dict[tuple[str, str], tuple[Error, Error]]]:
    """All runs of a case, and how well its tight traces are confirmed."""
    rays = case.bundle(ray_count)
    truth = None if case.exact is None else case.exact(rays)
    paired, checks = [], {}
    # Where rays bend through the whole field "straight" means nothing.
    settings = [setting for setting in SETTINGS if not (case.bends and setting.method == "straight")]
    # Nor do the kinked interpolants: on that grid their own error is a wave and more.
    for interpolation in INTERPOLATIONS[: 1 if quick or case.bends else None]:
        bench = Bench.prepare(case, interpolation, rays, truth)
        if not quick:
            checks[case.name, interpolation] = bench.check()
        for precision in ("float64",) if quick else PRECISIONS:
            paired += [(bench, bench.run(setting, precision)) for setting in (QUICK_SETTINGS if quick else settings)]
    measure_times(paired, case.bundle(timed_count), repeats, lambda k: say(f"  times, {k + 1} of {repeats}"))
    return [run for _, run in paired], checks


def measure_peers(ray_count: int) -> list[Run]:
    """The rays that others' figures are for."""
    runs = []
    for case in (radial_parallel(), sech(0.25e-3), sech(0.05e-3)):
        rays = case.bundle(ray_count)
        bench = Bench.prepare(case, "cubic", rays, case.exact(rays))
        runs += [bench.run(setting, precision) for precision in PRECISIONS for setting in PEER_SETTINGS]
    return runs


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
        some, confirmed = measure(case, *counts, options.quick)
        runs += some
        checks |= confirmed
        draw(some, case.title, "field evaluations per ray", evaluations, options.out / f"{name}_evaluations.png")
        draw(some, case.title, "kernel time per ray [µs]", Run.microseconds, options.out / f"{name}_time.png")
        say(f"  {len(some)} settings in {time.perf_counter() - start:.0f} s")
    write_csv(options.out / "runs.csv", HEADING, [run.row() for run in runs])

    tables = {
        "evaluations-rms": need_table(runs, lambda run: run.evaluations, "opd_rms"),
        "evaluations-tighter": need_table(
            runs, lambda run: run.evaluations, "opd_rms", targets=TIGHTER, precisions=("float64",)
        ),
        "evaluations-max": need_table(runs, lambda run: run.evaluations, "opd_max"),
        "time": need_table(runs, lambda run: run.microseconds()[0], "opd_rms"),
        "default": default_table(runs),
        "reported": report_table(runs),
        "floors": floor_table(runs),
    }
    if not options.quick:
        tables |= {"peers": peer_table(measure_peers(options.rays)), "checks": check_table(checks)}
    captions = {
        "evaluations-rms": "Field evaluations per ray for an rms tracing error [waves]",
        "evaluations-tighter": "The same for tighter targets, float64",
        "evaluations-max": "Field evaluations per ray for a greatest tracing error [waves]",
        "time": "Kernel time per ray [µs] for an rms tracing error [waves]",
        "default": "The default call: method auto, tolerance 1e-3 waves, float32; errors in waves",
        "reported": "Reported against made, over all runs",
        "floors": "The least error of any setting, rms [waves]",
        "peers": "Beside others' best: greatest total errors",
        "checks": "The tight traces against two others [waves]",
    }
    text = "\n".join(f"## {captions[name]}\n\n{table}" for name, table in tables.items())
    (options.out / "table.md").write_text(text, encoding="utf-8")
    if options.page is not None:
        try:
            put_between_marks(options.page, tables)
        except ValueError as fault:
            parser.error(f"--page: {fault}")
    say(f"\n{text}\nwrote {options.out}/table.md, runs.csv and two pictures for each field")


if __name__ == "__main__":
    main()
