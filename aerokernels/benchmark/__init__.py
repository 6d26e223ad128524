"""Benchmarks: measure speed together with the error on any device, and write JSON and a table.

    suite     what is measured
    cone      a million rays along z through the cone's volume: `trace(..., outputs=("direction", "optical_path"))`
    strehl    the Strehl ratio of the shipped Mach 3 field, from launch to value

docs/performance-bench.md describes the file.
"""

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

from aerokernels.benchmark.measuring import SUITES, Settings, find_targets

SCHEMA = "aerokernels-bench/2"

__all__ = ["SCHEMA", "SUITES", "Settings", "find_targets", "run_bench"]


def run_bench(settings: Settings, report: Callable[[str], None] = lambda line: None) -> dict[str, Any]:
    """Measure the requested suites; return a dictionary for JSON, described in docs/performance-bench.md.

    `report` is called with a line of text when a part begins. A ValueError names a backend or device that is not
    available; nothing is measured then.
    """
    from aerokernels.benchmark.measuring import machine
    from aerokernels.benchmark.suites import RUNS
    from aerokernels.jobs.store import to_json

    targets = find_targets(settings)
    begun = datetime.now(UTC).isoformat(timespec="seconds")
    runs = []
    for suite in settings.wanted:
        report(f"suite {suite}")
        for run in RUNS[suite](settings, targets):
            made = run["settings"]
            report(f"  {made['method']}, {made['precision']} on {made['backend']} {made['device']}: done")
            runs.append(run)
    return to_json({"schema": SCHEMA, "begun": begun, "machine": machine(), "runs": runs})
