"""Thousands of damaged flow files of every format: each is read as a gas, or refused with one line.

The sound files are those of tests/flow/reading; what is done to them stands in aerokernels/validation/damaged_files.py
and damaged_structure.py. They are read in a child process that may die (damaged_in_children.py), some 200 to 2000 a
second.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "flow" / "reading"))

import fuzzing

from aerokernels.validation.damaged_in_children import outcomes


def main() -> None:
    """Read the command line, and print counts as they grow; the first outcome of another kind ends it."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("kinds", nargs="*", help=f"of {', '.join((*fuzzing.KINDS, *fuzzing.CHILD_KINDS))}; all of them")
    parser.add_argument("--count", type=int, default=20_000, help="damaged copies of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="go on to the next kind after this long")
    given = parser.parse_args()
    for kind in given.kinds or (*fuzzing.KINDS, *fuzzing.CHILD_KINDS):
        counts, start = {"read": 0, "refused": 0, "ended": 0}, time.perf_counter()
        with tempfile.TemporaryDirectory() as scratch:
            sound = Path(scratch) / "sound"
            sound.mkdir()
            path = fuzzing.plain(sound, kind)
            seeds = range(given.seed, given.seed + given.count)
            for number, found in enumerate(outcomes(path, sound, Path(scratch) / "copy", seeds), start=1):
                counts[found] += 1
                late = time.perf_counter() - start > given.seconds
                if number % 5000 == 0 or late or number == given.count:
                    said = f"{counts['refused']} refused, {counts['read']} read"
                    if counts["ended"]:
                        said += f", {counts['ended']} refused because the library ended its process"
                    print(f"{kind:24s} {number:6d}: {said} ({time.perf_counter() - start:.0f} s)", flush=True)
                if late:
                    break


if __name__ == "__main__":
    main()
