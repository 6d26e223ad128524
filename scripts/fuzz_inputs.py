"""Drawn inputs of every parser: what was taken, what was refused in words, and each kind of fault once, with its seed.

The draws stand in aerokernels/validation/input_draws.py and file_draws.py. Exit status 1 where there is a fault.
"""

import argparse
import random
import tempfile
import time
import traceback
import warnings
from pathlib import Path

from aerokernels.validation import file_draws, input_draws

DRAWS = {**input_draws.DRAWS, **file_draws.DRAWS}


def main() -> int:
    """Draw, count, and print as it goes."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"of {', '.join(DRAWS)}; all of them")
    parser.add_argument("--count", type=int, default=1_000_000, help="draws of each kind")
    parser.add_argument("--seed", type=int, default=0, help="of the first draw; each has its own")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="go on to the next kind after this long")
    given = parser.parse_args()
    if unknown := set(given.kinds) - set(DRAWS):
        parser.error(f"no kind {', '.join(sorted(unknown))}: choose of {', '.join(DRAWS)}")
    warnings.simplefilter("ignore")
    faulty = False
    for kind in given.kinds or DRAWS:
        taken, kinds, start = 0, set(), time.monotonic()
        with tempfile.TemporaryDirectory(prefix="fuzz-inputs-") as scratch:
            for count in range(1, given.count + 1):
                seed = given.seed + count - 1
                try:
                    taken += DRAWS[kind](random.Random(seed), Path(scratch))
                except Exception as fault:
                    place = traceback.extract_tb(fault.__traceback__)[-1]
                    which = (type(fault).__name__, place.filename, place.lineno)
                    if which not in kinds:
                        kinds.add(which)
                        print(f"{kind}, seed {seed}: {type(fault).__name__}: {str(fault)[:200]} "
                              f"({Path(place.filename).name}:{place.lineno})", flush=True)  # fmt: skip
                if not count % 100 and time.monotonic() - start > given.seconds:
                    break
        faulty |= bool(kinds)
        print(f"{kind}: {count} drawn, {taken} taken, {len(kinds)} kinds of fault, "
              f"{time.monotonic() - start:.0f} s", flush=True)  # fmt: skip
    return int(faulty)


if __name__ == "__main__":
    raise SystemExit(main())
