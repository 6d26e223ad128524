"""Calibrate the errors that the package tells: python scripts/calibrate_errors.py [KIND,KIND..] [COUNT] [--out FILE].

Without arguments: 600 scenes of all kinds, some minutes on two cores. Prints, for each kind of scene and each number,
the share of scenes whose true error is within the error told, and the median and 95th percentile of told over true.
"""

import argparse
import json
import os
import sys
import warnings
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from calibration.run import LEAST, one

RESOLVED = (
    "turb3faded turb5faded turb8faded turb3 turb5 turb8 blob blobplanar blobaxi blobaxiacross shockC "
    "shockCplanar shockCaxi turb5planar turb3linear bloblinear shockCaverages blobaverages turb5averages "
    "turb3fadedshockC"
).split()
UNRESOLVED = (
    "shockA shockB shockAplanar shockBplanar shockAaxi shockBaxi shockAramp shockBramp shockAalong "
    "shockBalong shockBaverages turb5fadedshockB"
).split()


def main() -> None:
    """Run the scenes and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kinds", nargs="?", default=",".join(RESOLVED + UNRESOLVED))
    parser.add_argument("count", nargs="?", type=int, default=19)
    parser.add_argument("--out", type=Path)
    parser.add_argument(
        "--workers", type=int, default=os.cpu_count(), help="processes; the number of cores if left out"
    )
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    kinds = options.kinds.split(",")
    tasks = [(kind, seed) for kind in kinds for seed in range(options.count)]
    with ProcessPoolExecutor(options.workers, get_context("spawn")) as pool:
        found = list(pool.map(one, *zip(*tasks, strict=True), chunksize=4))
    if options.out is not None:
        options.out.write_text("".join(json.dumps(scene, default=float) + "\n" for scene in found))
    for kind in kinds:
        print(kind, *table([scene for scene in found if scene["kind"] == kind]), sep="\n", flush=True)
    for name, kinds in (("resolved", RESOLVED), ("unresolved jumps", UNRESOLVED)):
        print(name, *table([scene for scene in found if scene["kind"] in kinds]), sep="\n")


def table(scenes: list[dict]) -> list[str]:
    """Return a line for each number: coverage, median and 95th percentile of told over true, of some scenes."""
    lines = []
    for part in ("numbers", "rays"):
        for name in scenes[0][part] if scenes else ():
            rows = np.array([one[part][name][:3] for one in scenes])
            true, told, _ = rows[rows[:, 0] > LEAST * rows[:, 2]].T
            if not len(true):
                continue
            ratio = told / true
            lines.append(
                f"    {name:12s} {len(ratio):4d}  covered {100 * np.mean(ratio >= 1):4.0f} %  told/true"
                f" {np.median(ratio):8.2f}  {np.quantile(ratio, 0.95):9.1f}"
            )
    return lines


if __name__ == "__main__":
    main()
