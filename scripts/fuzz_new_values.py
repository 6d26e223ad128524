"""Compare Strehl ratios of fields that follow a known plan with those of their own plans, in random scenes.

tests/draws/new_values_draws.py makes the scenes and the checks.
"""

import argparse
import time

from tests.draws.new_values_draws import Finding, check, draw


def main() -> None:
    """Print a row for each ratio that differs by more than the errors told of both, then the counts."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--backend", default="opencl")
    parser.add_argument("--device", default=None)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="draw no further scene after this long")
    given = parser.parse_args()
    engine = {"backend": given.backend} | ({"device": given.device} if given.device else {})
    found: list[Finding] = []
    start = time.perf_counter()
    for seed in range(given.seed, given.seed + given.count):
        if time.perf_counter() - start > given.seconds:
            break
        case = draw(seed)
        try:
            findings = check(case, **engine)
        except ValueError as refused:
            print(f"{seed:6d} refused: {refused}", flush=True)
            continue
        found += findings
        for each in findings:
            if each.follows and each.share > 1.0:
                print(f"{seed:6d} field {each.number}: {each.share:.2g} of the errors told: {case.kind}", flush=True)
    followed = [each.share for each in found if each.follows]
    print(
        f"{len(found)} fields, {len(followed)} of which followed; their ratios differ by at most "
        f"{max(followed, default=0.0):.2g} of the errors told"
    )


if __name__ == "__main__":
    main()
