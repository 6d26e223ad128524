"""Check that the reported error covers the true error, in random scenes that combine what tracers get wrong.

tests/draws/scene_draws.py makes the scenes, and scene_check.py beside it the checks.
"""

import argparse
import time

import numpy as np

from tests.draws.scene_check import Finding, check
from tests.draws.scene_draws import draw


def main() -> None:
    """Print a row for each scene whose error is not covered, then the counts."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--backend", default="both", choices=["opencl", "warp", "both"])
    parser.add_argument("--only", type=int, help="one scene by its seed")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="draw no further scene after this long")
    given = parser.parse_args()
    seeds = [given.only] if given.only is not None else range(given.seed, given.seed + given.count)
    outcomes: dict[str, list[Finding]] = {}
    start = time.perf_counter()
    for seed in seeds:
        if time.perf_counter() - start > given.seconds:
            break
        scene = draw(seed)
        backend = given.backend if given.backend != "both" else ("opencl", "warp")[seed % 2]
        for finding in check(scene, backend):
            outcomes.setdefault(finding.what, []).append(finding)
            if not finding.covered or given.only is not None:
                print(
                    f"{seed:6d} {backend:6s} {finding.what:6s} error {finding.true_error:.2e}, "
                    f"total {finding.total:.2e}, "
                    f"{'covered' if finding.covered else 'flagged' if finding.flagged else 'SILENT'}: {scene.kind}",
                    flush=True,
                )
    for what, found in outcomes.items():
        covered = sum(f.covered for f in found)
        loud = sum(f.covered or f.flagged for f in found)
        ratios = [f.total / f.true_error for f in found if f.true_error > 0.0 and np.isfinite(f.total)]
        ratio = float(np.median(ratios)) if ratios else float("nan")
        print(
            f"{what}: {len(found)} scenes, covered {100.0 * covered / len(found):.1f} %, covered or flagged "
            f"{100.0 * loud / len(found):.1f} %, median of total over error {ratio:.1f}"
        )


if __name__ == "__main__":
    main()
