"""Test the verdict on ray optics: rays against a finely sampled wave, through random shocks and turbulence.

The views and the comparison are those of tests/draws/wave_draws.py.
"""

import argparse
from collections import Counter

import numpy as np

from tests.draws.wave_draws import (
    GOOD,
    KINDS,
    MAP_PIXELS,
    WAVE_PIXELS,
    VerdictCheck,
    check_verdict,
    draw_view,
)


def row(name: str, found: list[VerdictCheck]) -> str:
    """Return a row of the table."""
    counts = Counter((one.is_good, one.said_good) for one in found)
    right = 100.0 * sum(one.right for one in found) / max(len(found), 1)
    return (
        f"| {name} | {len(found)} | {counts[True, True]} | {counts[False, False]} | {counts[False, True]} | "
        f"{counts[True, False]} | {right:.1f} % |"
    )


def main() -> None:
    """Print a row for each wrong verdict, then the counts."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--limit", type=float, default=GOOD, help="change of the Strehl ratio that is good")
    parser.add_argument("--pixels", type=int, default=WAVE_PIXELS, help="of the window of the wave that is the truth")
    parser.add_argument("--map", type=int, default=MAP_PIXELS, help="pixels of the traced wavefront")
    parser.add_argument("--only", type=int, help="one view by its seed")
    given = parser.parse_args()
    seeds = [given.only] if given.only is not None else range(given.seed, given.seed + given.count)
    by_kind: dict[str, list[VerdictCheck]] = {kind: [] for kind in KINDS}
    for seed in seeds:
        view = draw_view(seed)
        found = check_verdict(view, given.limit, given.pixels, given.map)
        by_kind[view.kind].append(found)
        if not found.right or given.only is not None:
            print(
                f"{seed:5d} {view.kind:10s} {'right' if found.right else 'WRONG'}: rays {found.by_rays:.4f}, wave "
                f"{found.by_wave:.4f} +- {found.wave_error:.1g}, reported change {found.reported:+.4f}",
                flush=True,
            )
    all_of_them = [one for found in by_kind.values() for one in found]
    print("| kind | views | good, told so | bad, told so | bad, told good | good, told bad | right |")
    print(7 * "|---" + "|")
    for kind, found in by_kind.items():
        if found:
            print(row(kind, found))
    print(row("all", all_of_them))
    seconds = np.array([one.seconds for one in all_of_them])
    print(
        f"median {1e3 * np.median(seconds[:, 1]):.3g} ms of processor time, at worst {1e3 * seconds[:, 1].max():.3g} ms"
    )


if __name__ == "__main__":
    main()
