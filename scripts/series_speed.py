"""Snapshots to maps of optical path differences: speed and error; see aerokernels/validation/series_speed.py."""

import argparse
import json
from pathlib import Path

from aerokernels.validation.report import markdown_table
from aerokernels.validation.series_speed import COLUMNS, PIXELS, SHAPE, measure_series, table_rows


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(prog="scripts/series_speed", description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="write what was measured to this JSON file")
    parser.add_argument("--snapshots", type=int, default=8, metavar="COUNT", help="snapshots of a series")
    parser.add_argument("--quick", action="store_true", help="a small volume, to see that it works")
    options = parser.parse_args()
    if options.snapshots < 3:
        parser.error(f"--snapshots: {options.snapshots} is too few, give at least 3")
    shape, pixels = ((45, 45, 31), 24) if options.quick else (SHAPE, PIXELS)
    found = measure_series(shape, pixels, options.snapshots)
    print(markdown_table(COLUMNS, table_rows(found)))
    for one in found:
        if "gpu" in one:
            share = one["copy_seconds"] / one["gpu_host_seconds"]
            told = f"{1e3 * one['gpu_host_seconds']:.2f} ms from the host, {100.0 * share:.0f} % of the copy's rate"
            print(f"{one['gpu']}, {one['rays']}: {told}; {1e3 * one['gpu_device_seconds']:.2f} ms on the device")
    if options.out is not None:
        options.out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
