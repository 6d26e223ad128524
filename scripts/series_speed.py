"""Time the way from snapshots to maps of optical path differences, with the error; see validation/series_speed.py."""

import argparse
import json
import time
from pathlib import Path
from typing import Any

from aerokernels.series.snapshot import gpu_of
from aerokernels.validation import series_gpu
from aerokernels.validation.report import markdown_table
from aerokernels.validation.series_speed import COLUMNS, PIXELS, SHAPE, measure_series, table_rows


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(prog="scripts/series_speed", description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="write what was measured to this JSON file")
    parser.add_argument("--snapshots", type=int, default=8, metavar="COUNT", help="snapshots of a series")
    parser.add_argument("--quick", action="store_true", help="a small volume, to see that it works")
    parser.add_argument(
        "--device", help="measure on this device of Warp's alone, cuda:0 or cpu [a GPU if there is one]"
    )
    parser.add_argument("--processor", action="store_true", help="measure on the processor's cores, even beside a GPU")
    options = parser.parse_args()
    if options.snapshots < 3:
        parser.error(f"--snapshots: {options.snapshots} is too few, give at least 3")
    shape, pixels = ((45, 45, 31), 24) if options.quick else (SHAPE, PIXELS)
    device = None if options.processor else options.device or gpu_of("auto", None)
    found: list[dict[str, Any]] = []
    if device is None:
        found = measure_series(shape, pixels, options.snapshots)
        print(markdown_table(COLUMNS, table_rows(found)))
    else:
        found = on_device(shape, pixels, device, (45.0, 256) if options.quick else (1.0, 256 * 256))
    if options.out is not None:
        options.out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def on_device(shape: tuple[int, int, int], pixels: int, device: str, regard: tuple[float, int]) -> list[dict[str, Any]]:
    """Return a device's figures, printing each row when it is measured, and the table."""
    begin = time.perf_counter()
    found: list[dict[str, Any]] = []

    def told(one: dict[str, Any]) -> None:
        found.append(one)
        print(f"{time.perf_counter() - begin:6.1f} s  " + "; ".join(filter(None, series_gpu.gpu_row(one))), flush=True)

    for one in series_gpu.measure_gpu(shape, pixels, device):
        told(one)
    told(series_gpu.measure_regard(device, *regard))
    print(f"\n{device}\n" + markdown_table(series_gpu.COLUMNS, [series_gpu.gpu_row(one) for one in found]))
    return found


if __name__ == "__main__":
    main()
