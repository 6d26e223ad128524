"""Every public call with each argument replaced by foreign bodies: counts what answered, was refused, or failed.

    scripts/fuzz_arguments [SECONDS] [SEED]

Without SECONDS each case is tried once; with it, cases are drawn at random until the time is over.
"""

import sys
import time

from aerokernels.validation import argument_draws


def main() -> int:
    """Draw, count, and print as it goes; the number of kinds of fault is the exit status, at most 1."""
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
