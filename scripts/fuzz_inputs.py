"""Feed random input to every parser: count what is read and what is refused in words, print faults with their seeds.

The inputs are those of tests/draws/parser_draws.py. They run in separate processes. A process that is ended
by a signal, hangs or requests more than 4 GB is a fault of its seed, and another process goes on after it. Exit status
1 if there is a fault. Needs `fork`.
"""

import argparse
import os
import random
import resource
import signal
import tempfile
import traceback
import warnings
from pathlib import Path
from types import FrameType
from typing import NoReturn

from aerokernels.files import netcdf_reading  # noqa: F401  # so that forked readers have it
from tests.draws.draws_in_processes import Report, share
from tests.draws.forked_readers import addresses, fork_readers
from tests.draws.parser_draws import DRAWS

MEMORY, LONGEST = 4_000_000_000, 5.0  # [bytes] of a process's addresses beyond its parent's, [s] of computing per input


class TooLong(BaseException):
    """An input takes too long; not an Exception, so that no reader catches it as a fault of a file."""


def _too_long(number: int, frame: FrameType | None) -> NoReturn:
    raise TooLong(f"longer than {LONGEST:g} s")


def work(kind: str, seeds: range, folder: Path, report: Report) -> None:
    """Parse one input after the other, and report the outcomes."""
    draw = DRAWS[kind]
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    resource.setrlimit(resource.RLIMIT_AS, (int(addresses()) + MEMORY, hard))
    signal.signal(signal.SIGPROF, _too_long)
    for seed in seeds:
        try:
            signal.setitimer(signal.ITIMER_PROF, LONGEST)
            taken = draw(random.Random(seed), folder)
            signal.setitimer(signal.ITIMER_PROF, 0.0)
        except (Exception, TooLong) as fault:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            place = traceback.extract_tb(fault.__traceback__)[-1]
            where = f"{Path(place.filename).name}:{place.lineno}"
            report.fault(seed, f"{type(fault).__name__}: {str(fault)[:200]} ({where})")
        else:
            report.outcome("read" if taken else "refused")
        if report.late():
            return


def main() -> int:
    """Read the command line, and share the draws over processes."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"of {', '.join(DRAWS)}; all of them")
    parser.add_argument("--count", type=int, default=1_000_000, help="draws of each kind")
    parser.add_argument("--seed", type=int, default=0, help="of the first draw; each has its own")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="end after this long")
    parser.add_argument("--processes", type=int, default=1)
    given = parser.parse_args()
    if unknown := set(given.kinds) - set(DRAWS):
        parser.error(f"no kind {', '.join(sorted(unknown))}: choose of {', '.join(DRAWS)}")
    warnings.simplefilter("ignore")
    fast = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None  # a disk would be most of the time
    with tempfile.TemporaryDirectory(prefix="fuzz-inputs-", dir=fast) as scratch:
        kinds = given.kinds or tuple(DRAWS)
        fork_readers()
        for kind in kinds:  # what libraries import when they are first used is there before processes are forked
            for seed in range(10_000, 10_010):
                DRAWS[kind](random.Random(seed), Path(scratch))
        seeds = range(given.seed, given.seed + given.count)
        found = share(work, kinds, seeds, given.processes, given.seconds, Path(scratch) / "draws")
    return int(any(found.values()))


if __name__ == "__main__":
    raise SystemExit(main())
