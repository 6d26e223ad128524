"""Compare random bundles through random fields with the reference: failures by kind, and the worst with their seeds.

The cases and checks are those of tests/draws/bundle_draws.py. `--only SEED` repeats a case.
"""

import argparse
import collections
import multiprocessing
import sys
import time
import traceback
import warnings
from collections.abc import Iterator
from typing import NamedTuple

from tests.draws.bundle_check import Finding, check
from tests.draws.bundle_draws import draw


def parse(arguments=None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000, help="bundles to draw")
    parser.add_argument("--seed", type=int, default=0, help="the first one's seed; the others follow")
    parser.add_argument("--backend", default="opencl", choices=("opencl", "warp", "reference"))
    parser.add_argument("--sample", type=int, default=300, help="rays of a bundle that are compared")
    parser.add_argument("--only", type=int, help="this seed alone, with every ray that fails")
    parser.add_argument("--fix", action="append", default=[], metavar="NAME=VALUE", help="an entry of the kind to fix")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="draw no further bundle after this long")
    parser.add_argument("--patience", type=int, default=60, help="give a bundle up after so many seconds, and count it")
    parser.add_argument("--processes", type=int, default=1, help="processes to share the bundles")
    parser.add_argument("--worst", type=int, default=40, help="cases to list")
    return parser.parse_args(arguments)


class Outcome(NamedTuple):
    """Result of a bundle: how it was traced, rays compared, and what is wrong with them; or why it was not traced."""

    seed: int
    case: str
    geometry: str
    how: str
    compared: int
    findings: list[Finding]
    error: str = ""


def outcome(seed: int, asked: argparse.Namespace) -> Outcome:
    """Make, trace and check one bundle."""
    fixed = dict(entry.split("=", 1) for entry in asked.fix)
    case = draw(seed, **fixed)
    if case.kind["bundle"] == "spanwise" and "count" not in fixed:
        case = draw(seed, count="300", **fixed)  # a thousand boxes along x: one ray takes as long as a bundle
    try:
        findings, compared, how = check(case, [{"backend": asked.backend}], asked.sample)
    except Exception:  # a case that cannot be traced is a finding too, unless the bundle misses the box
        return Outcome(seed, str(case), case.kind["geometry"], "", 0, [], traceback.format_exc().splitlines()[-1])
    return Outcome(seed, str(case), case.kind["geometry"], how, compared, findings)


def work(seeds: range, asked: argparse.Namespace, sent) -> None:
    """Check bundle after bundle in a separate process, which may be ended inside a kernel."""
    warnings.simplefilter("ignore")
    for seed in seeds:
        sent.send(seed)
        sent.send(outcome(seed, asked))


class Worker:
    """A process and its remaining seeds; if it is stuck on a seed, it is ended and restarted with the next one."""

    def __init__(self, seeds: range, asked: argparse.Namespace):
        """Start on `seeds`."""
        self.asked = asked
        self.start(seeds)

    def start(self, seeds: range) -> None:
        """Start with the first of `seeds`."""
        self.seeds, self.seed = seeds, None
        self.heard = time.monotonic()
        self.answers, sent = multiprocessing.get_context("spawn").Pipe(duplex=False)
        self.process = multiprocessing.get_context("spawn").Process(
            target=work, args=(seeds, self.asked, sent), daemon=True
        )
        self.process.start()
        sent.close()

    def read(self) -> Outcome | int | None:
        """Return an outcome, a seed that was given up, or None; raise EOFError at the end."""
        told = self.answers.recv() if self.answers.poll() else None
        if told is not None:
            self.heard = time.monotonic()
            self.seed = told if isinstance(told, int) else None
            return None if isinstance(told, int) else told
        died = not self.process.is_alive()
        if died and self.seed is None:
            raise EOFError
        # A process's first answer includes the time of all imports.
        if died or time.monotonic() - self.heard > self.asked.patience + (30.0 if self.seed is None else 0.0):
            given_up = self.seeds[0] if self.seed is None else self.seed
            self.stop()
            self.start(range(given_up + 1, self.seeds.stop))
            return given_up
        return None

    def stop(self) -> None:
        """End the process."""
        self.process.kill()
        self.process.join()


def outcomes(asked: argparse.Namespace) -> Iterator[Outcome | int]:
    """Yield the bundles' outcomes, and the seeds that are given up, as they arrive."""
    share = -(-asked.count // asked.processes)
    stop = asked.seed + asked.count
    starts = range(asked.seed, stop, share)
    workers = [Worker(range(first, min(first + share, stop)), asked) for first in starts]
    end = time.monotonic() + asked.seconds
    try:
        while workers and time.monotonic() < end:
            time.sleep(0.002)
            for worker in tuple(workers):
                try:
                    told = worker.read()
                except EOFError:
                    workers.remove(worker)
                    continue
                if told is not None:
                    yield told
    finally:
        for worker in workers:
            worker.stop()


def main() -> int:
    """Run the bundles and print what fails."""
    asked = parse()
    if asked.only is not None:
        return one(asked)
    start, rays, drawn, failed = time.perf_counter(), 0, collections.Counter(), collections.Counter()
    wrong_rays, worst, errors = collections.Counter(), [], []
    missed = given_up = 0
    for told in outcomes(asked):
        if isinstance(told, int):
            given_up += 1
            print(f"given up: seed {told}", file=sys.stderr, flush=True)
            continue
        if told.error:
            missed += "meets the field" in told.error
            if "meets the field" not in told.error:
                errors.append((told.seed, told.error))
            continue
        rays += told.compared
        drawn[told.how] += 1
        for what in {f.what for f in told.findings}:
            group = [f for f in told.findings if f.what == what]
            failed[told.how, what, told.geometry] += 1
            wrong_rays[what] += len(group)
            greatest = max(group, key=lambda f: f.size)
            worst.append((greatest.size, told.how, len(group), told.compared, greatest, told.case))
            print(line(worst[-1]), file=sys.stderr, flush=True)
        if sum(drawn.values()) % 20 == 0:  # so that an interrupted run has printed its counts
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
    """Describe one failure of a case."""
    size, how, n, compared, finding, case = entry
    return f"{finding.what} {size:.2g} x, {n}/{compared} rays, {how}; {case}; ray {finding.ray}: {finding.text}"


def one(asked: argparse.Namespace) -> int:
    """Run one case and print all its findings."""
    fixed = dict(entry.split("=", 1) for entry in asked.fix)
    case = draw(asked.only, **fixed)
    print(case, case.settings, f"box {case.field.box}, spacing {case.field.spacing}", sep="\n")
    findings, compared, how = check(case, [{"backend": asked.backend}], asked.sample)
    print(f"{how}, {compared} rays compared, {len(findings)} findings")
    for finding in sorted(findings, key=lambda f: -f.size):
        print(f"  {finding.what} {finding.size:.2g} x, ray {finding.ray}: {finding.text}")
    return 1 if findings else 0


if __name__ == "__main__":
    raise SystemExit(main())
