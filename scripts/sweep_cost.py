"""Time a sweep beside its tracing; see aerokernels/validation/sweep_cost.py."""

import argparse

from aerokernels.validation.report import markdown_table
from aerokernels.validation.sweep_cost import COLUMNS, measure_sweep, table_rows, worker_counts


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(prog="scripts/sweep_cost", description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=1000, help="cases of the sweep, a third of them for each flow")
    parser.add_argument("--workers", type=int, nargs="+", help="numbers of workers [1, 2, 4 ... GPUs, or cores]")
    options = parser.parse_args()
    if options.cases < 3 or min(options.workers or [1]) < 1:
        parser.error("--cases must be at least 3, and --workers at least 1")
    print(markdown_table(COLUMNS, table_rows(measure_sweep(options.cases, options.workers or worker_counts()))))


if __name__ == "__main__":
    main()
