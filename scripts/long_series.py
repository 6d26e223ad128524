"""Many small snapshots through a store on disk; see aerokernels/validation/long_series.py."""

import argparse
import tempfile
from pathlib import Path

from aerokernels.validation.long_series import EVERY, measure


def main() -> None:
    """Measure, and say what came out."""
    parser = argparse.ArgumentParser(prog="scripts/long_series", description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=10_000, help="snapshots")
    parser.add_argument("--kills", type=int, default=5, metavar="COUNT", help="how often the second run is killed")
    parser.add_argument("--out", type=Path, help="keep the stores in this folder")
    options = parser.parse_args()
    if options.count < 2 or options.kills < 0:
        parser.error("--count must be at least 2, and --kills at least 0")
    with tempfile.TemporaryDirectory() as folder:
        found = measure(options.count, options.out or Path(folder), options.kills)
    print(f"{found['snapshots']} snapshots, {found['per_second']:.0f} a second")
    held = [round(one / 2**20, 1) for one in found["resident_bytes"]]
    if held:
        step = max(1, len(held) // 10)
        print(f"memory [MiB] at every {step * EVERY} snapshots: {', '.join(map(str, held[step - 1 :: step]))}")
    print(f"killed at {found['killed_at']}; then the same as the run left alone: {found['same']}")
    if not found["same"]:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
