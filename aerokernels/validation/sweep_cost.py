"""Measure the overhead of a sweep over its tracing, and its scaling with workers: Mach number x tilt on 1, 2, ...

A sweep of the shipped wind-tunnel scene over the three flows and many tilts is timed from the start of its processes to
the written dataset and report. Given are the wall time, the CPU time of all processes and threads, and the CPU time of
tracing alone (calls of `trace`, Strehl ratios and the rays of error budgets, including their plans), as the cases
record it. The quotient of the CPU times is the overhead of the sweep. `trace_seconds` of the cases does not measure it:
that is wall time in kernels, which run on all cores at once, and excludes plans. On GPUs, of which each worker has one,
tracing takes no CPU time, and the quotient is not meaningful.
"""

import resource
import tempfile
import time
from pathlib import Path

import numpy as np

from aerokernels.jobs.sweeps.gpus import visible_gpus
from aerokernels.jobs.sweeps.run import sweep
from aerokernels.process.machine import core_count

SCENE, FLOWS = "wind-tunnel-mach3", ("mach2", "mach3", "mach4")
GREATEST_TILT = 30.0  # [degrees]
COLUMNS = ("workers", "cases", "wall", "a case", "processor", "of that tracing", "processor / tracing", "speed-up")


def worker_counts() -> list[int]:
    """1, 2, 4 ... up to the number of GPUs of this machine, or of its cores where it has none."""
    most = len(visible_gpus()) or min(core_count(), 8)
    return sorted({min(2**k, most) for k in range(10)})


def measure_sweep(cases: int, workers: list[int]) -> list[dict[str, float]]:
    """Measure a sweep; return one dictionary for each number of workers."""
    tilts = [f"{tilt:.6g} deg" for tilt in np.linspace(0.0, GREATEST_TILT, max(1, round(cases / len(FLOWS))))]
    found = []
    for count in workers:
        with tempfile.TemporaryDirectory() as folder:
            begin, busy = time.perf_counter(), processor_seconds()
            result = sweep(
                SCENE,
                {"flow.source": list(FLOWS), "target.tilt": tilts},
                workers=count,
                out=Path(folder) / "out",
            )
            wall, busy = time.perf_counter() - begin, processor_seconds() - busy
        failed = int(result.failed.sum())
        if failed:
            raise RuntimeError(f"{failed} of {result.failed.size} cases failed")
        tracing = float(result.tracing_processor_seconds.sum())
        cases = int(result.failed.size)
        found.append({"workers": count, "cases": cases, "wall_seconds": wall, "processor": busy, "tracing": tracing})
    return found


def processor_seconds() -> float:
    """CPU time of this process and of its children that have ended [s]."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def table_rows(found: list[dict[str, float]]) -> list[tuple[str, ...]]:
    """One row of texts for each number of workers, in the order of COLUMNS."""
    return [
        (
            f"{one['workers']:.0f}",
            f"{one['cases']:.0f}",
            f"{one['wall_seconds']:.1f} s",
            f"{one['wall_seconds'] / one['cases']:.3f} s",
            f"{one['processor']:.1f} s",
            f"{one['tracing']:.1f} s",
            f"{one['processor'] / one['tracing']:.2f}",
            f"{found[0]['wall_seconds'] / one['wall_seconds']:.2f}",
        )
        for one in found
    ]
