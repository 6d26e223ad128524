"""Read thousands of damaged flow files of every format: each must be read as a gas, or refused with one line.

The sound files are those of tests/flow/reading; damaged_files.py and damaged_structure.py in tests/draws
damage them. They are read in separate processes, which may be ended by a signal or hang; readers that depend on
libraries run in forks of those processes. Every other outcome is printed with its seed, and the exit status is then 1.
"""

import argparse
import os
import sys
import tempfile
import traceback
import warnings
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "flow" / "reading"))

import fuzzing

from aerokernels.flow.reading.formats import format_of, read_here
from tests.draws.damaged_files import DamagedCopies
from tests.draws.draws_in_processes import Report, share
from tests.draws.forked_readers import fork_readers


def main() -> int:
    """Write the sound files, and read the damaged copies in several processes."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    every = (*fuzzing.KINDS, *fuzzing.CHILD_KINDS)
    parser.add_argument("kinds", nargs="*", help=f"of {', '.join(every)}; all of them")
    parser.add_argument("--count", type=int, default=20_000, help="damaged copies of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="end after this long")
    parser.add_argument("--processes", type=int, default=1)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    fast = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None  # a disk would take most of the time
    with tempfile.TemporaryDirectory(prefix="fuzz-files-", dir=fast) as scratch:
        paths = {}
        for kind in given.kinds or every:
            (folder := Path(scratch) / "sound" / kind).mkdir(parents=True)
            try:
                paths[kind] = fuzzing.plain(folder, kind)
                read_here(format_of(paths[kind], {}).module, paths[kind], None, {})  # loads its libraries
            except ModuleNotFoundError as missing:
                print(f"{kind}: left out, {missing}", flush=True)
                paths.pop(kind, None)

        def work(kind: str, seeds: range, copies: Path, report: Report) -> None:
            made = DamagedCopies(paths[kind], Path(scratch) / "sound" / kind, copies / "copy")
            for seed in seeds:
                try:
                    report.outcome(made.outcome(seed))
                except Exception:
                    report.fault(seed, traceback.format_exc())
                if report.late():
                    return

        fork_readers()
        seeds = range(given.seed, given.seed + given.count)
        found = share(work, paths, seeds, given.processes, given.seconds, Path(scratch) / "copies")
        return int(any(found.values()))


if __name__ == "__main__":
    raise SystemExit(main())
