"""Replace each argument of every public call by foreign objects: count what is answered, refused, or fails.

    scripts/fuzz_arguments [SECONDS] [SEED]

Without SECONDS each case is tried once; with SECONDS, cases are chosen at random until the time is over.
"""

import sys
import time

from tests.draws import argument_draws


def main() -> int:
    """Run cases and print results; return 1 if there is any fault."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else None
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    end = None if seconds is None else time.monotonic() + seconds
    total, kinds = argument_draws.Tally(), set()
    while True:
        part = argument_draws.run(None if end is None else 1000, None if end is None else seed)
        total.answered += part.answered
        total.refused += part.refused
        for fault in part.faults:
            if fault not in kinds:
                kinds.add(fault)
                print(*fault, sep=" | ", flush=True)
        total.faults += part.faults
        print(f"{total.count} cases: {total.answered} answered, {total.refused} refused, {len(total.faults)} faults",
              flush=True)  # fmt: skip
        seed += 1
        if end is None or time.monotonic() > end:
            return int(bool(kinds))


if __name__ == "__main__":
    raise SystemExit(main())
