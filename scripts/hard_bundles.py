"""Trace bundles through fields with features between traced lines: count rays with unreported errors above tolerance.

The fields and checks are those of tests/draws/hard_bundles.py. Exit status 1 if a ray is wrong.
"""

import argparse
import time

from tests.draws.hard_bundles import SIDE, check


def main() -> int:
    """Check the seeds one by one, print each wrong one, and the totals."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200, help="fields")
    parser.add_argument("--seed", type=int, default=0, help="the first one's seed; the others follow")
    parser.add_argument("--backend", default="opencl", choices=("opencl", "warp"))
    parser.add_argument("--seconds", type=float, default=float("inf"), help="begin no further field after this long")
    asked = parser.parse_args()
    begun, done, delivered, wrong, worst = time.perf_counter(), 0, 0, 0, 0.0
    for seed in range(asked.seed, asked.seed + asked.count):
        if time.perf_counter() - begun > asked.seconds:
            break
        found = check(seed, backend=asked.backend)
        done, delivered, wrong = done + 1, delivered + found.delivered, wrong + found.wrong
        worst = max(worst, found.worst)
        if found.wrong or found.worst > 1.0 or found.statuses:
            print(f"seed {seed}: {found}", flush=True)
    print(
        f"{done} fields, {done * SIDE**2} rays, {delivered} of them interpolated: {wrong} worse than is told; greatest "
        f"error of a ray without a status {worst:.2g} tolerances; {time.perf_counter() - begun:.0f} s"
    )
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
