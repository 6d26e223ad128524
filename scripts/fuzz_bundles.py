"""Random bundles through random fields against the reference: what fails, by kind, and the worst with their seeds.

The cases and what is held are those of aerokernels/validation/bundle_draws.py. A case is repeated by `--only SEED`.
"""

import argparse
import collections
import signal
import sys
import time
import traceback

from aerokernels.validation.bundle_check import check
from aerokernels.validation.bundle_draws import draw


def parse(arguments=None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000, help="bundles to draw")
    parser.add_argument("--seed", type=int, default=0, help="the first one's seed; the others follow")
    parser.add_argument("--backend", default="opencl", choices=("opencl", "warp", "reference"))
    parser.add_argument("--sample", type=int, default=300, help="rays of a bundle that are compared")
    parser.add_argument("--only", type=int, help="this seed alone, with every ray that fails")
    parser.add_argument("--fix", action="append", default=[], metavar="NAME=VALUE", help="an entry of the kind to fix")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="draw no further bundle after this long")
    parser.add_argument("--patience", type=int, default=60, help="give a bundle up after so many seconds, and count it")
    parser.add_argument("--worst", type=int, default=40, help="cases to list")
    return parser.parse_args(arguments)


class GivenUpError(Exception):
    """A bundle took longer than the caller waits."""


def _give_up(_signal, _frame):
    raise GivenUpError


def main() -> int:
    """Draw, check, tell."""
    asked = parse()
    fixed = dict(entry.split("=", 1) for entry in asked.fix)
    if asked.only is not None:
        return one(asked, fixed)
    start, rays, drawn, failed = time.perf_counter(), 0, collections.Counter(), collections.Counter()
    wrong_rays, worst, errors = collections.Counter(), [], []
    seeds = range(asked.seed, asked.seed + asked.count)
    missed = given_up = 0
    signal.signal(signal.SIGALRM, _give_up)
    for number, seed in enumerate(seeds, 1):
        if time.perf_counter() - start > asked.seconds:
            break
        case = draw(seed, **fixed)
        if case.kind["bundle"] == "spanwise" and "count" not in fixed:
            case = draw(seed, count="300", **fixed)  # a thousand boxes along x: each ray costs as much as a bundle
        signal.alarm(asked.patience)
        try:
            findings, compared, how = check(case, {"backend": asked.backend}, asked.sample)
        except GivenUpError:
            given_up += 1
            print(f"given up: {case}", file=sys.stderr, flush=True)
            continue
        except Exception:  # a case that cannot be traced is a finding too, but for bundles that miss the box
            text = traceback.format_exc().splitlines()[-1]
            missed += "meets the field" in text
            if "meets the field" not in text:
                errors.append((seed, text))
            continue
        finally:
            signal.alarm(0)
        rays += compared
        drawn[how] += 1
        for what in {f.what for f in findings}:
            group = [f for f in findings if f.what == what]
            failed[how, what, case.kind["geometry"]] += 1
            wrong_rays[what] += len(group)
            greatest = max(group, key=lambda f: f.size)
            worst.append((greatest.size, how, len(group), compared, greatest, case))
            print(line(worst[-1]), file=sys.stderr, flush=True)
        if number % 20 == 0:  # one that is cut off has still counted
            found = ", ".join(f"{w} {n}" for w, n in wrong_rays.most_common()) or "none"
            seconds = time.perf_counter() - start
            print(
                f"{sum(drawn.values())} bundles, {rays} rays, wrong: {found}, {seconds:.0f} s",
                file=sys.stderr,
                flush=True,
            )
    traced = sum(drawn.values())
    print(
        f"{asked.backend}: {traced} bundles traced, {missed} refused since no ray meets the field, "
        f"{given_up} given up after {asked.patience} s, {len(errors)} not traced, "
        f"{rays} rays compared, {time.perf_counter() - start:.0f} s"
    )
    print("traced by: " + ", ".join(f"{how} {n}" for how, n in drawn.most_common()))
    print("rays beyond what is allowed: " + (", ".join(f"{w} {n}" for w, n in wrong_rays.most_common()) or "none"))
    for (how, what, geometry), n in sorted(failed.items(), key=lambda item: -item[1]):
        print(f"  {n:5d} bundles: {what:9s} {how:9s} {geometry}")
    for what in ("status", "opd", "end", "arc", "direction"):
        some = sorted((w for w in worst if w[4].what == what), key=lambda w: -w[0])[: asked.worst]
        if some:
            print(f"worst by {what}:")
        for entry in some:
            print("  " + line(entry))
    for seed, text in errors:
        print(f"  seed {seed}: {text}")
    return 1 if worst or errors else 0


def line(entry) -> str:
    """One failure of a case in words."""
    size, how, n, compared, finding, case = entry
    return f"{finding.what} {size:.2g} x, {n}/{compared} rays, {how}; {case}; ray {finding.ray}: {finding.text}"


def one(asked: argparse.Namespace, fixed: dict) -> int:
    """One case in full."""
    case = draw(asked.only, **fixed)
    print(case, case.settings, f"box {case.field.box}, spacing {case.field.spacing}", sep="\n")
    findings, compared, how = check(case, {"backend": asked.backend}, asked.sample)
    print(f"{how}, {compared} rays compared, {len(findings)} findings")
    for finding in sorted(findings, key=lambda f: -f.size):
        print(f"  {finding.what} {finding.size:.2g} x, ray {finding.ray}: {finding.text}")
    return 1 if findings else 0


if __name__ == "__main__":
    raise SystemExit(main())
