"""Drawn inputs of every parser: what was taken, what was refused in words, and each kind of fault once, with its seed.

The draws stand in aerokernels/validation/input_draws.py, file_draws.py and record_draws.py. They run in a process of
their own, which may be ended by a signal or hang: that is a fault of its seed, and another process goes on after it.
Exit status 1 where there is a fault. Needs `fork`.
"""

import argparse
import mmap
import os
import random
import signal
import struct
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path

from aerokernels.validation import file_draws, input_draws, record_draws

DRAWS = {**input_draws.DRAWS, **record_draws.DRAWS, **file_draws.DRAWS}
HANGS = 60.0  # [s] of one draw
AT_ONCE = 50_000  # draws of one process: what its libraries keep goes with it
_STATE = struct.Struct("<qq")  # draws done, of them taken


def work(kind: str, first: int, count: int, end: float, folder: Path, state: mmap.mmap, known: set[tuple]) -> None:
    """Draw one after the other, and say where it is; what is new goes to stdout."""
    taken = 0
    for number in range(count):
        seed = first + number
        try:
            taken += DRAWS[kind](random.Random(seed), folder)
        except Exception as fault:
            place = traceback.extract_tb(fault.__traceback__)[-1]
            which = (type(fault).__name__, place.filename, place.lineno)
            if which not in known:
                known.add(which)
                print(f"{kind}, seed {seed}: {type(fault).__name__}: {str(fault)[:200]} "
                      f"({Path(place.filename).name}:{place.lineno})", flush=True)  # fmt: skip
        state[:] = _STATE.pack(number + 1, taken)
        if not number % 100 and time.monotonic() > end:
            break


def batch(kind: str, first: int, count: int, end: float, folder: Path) -> tuple[int, int, int]:
    """Draws of one process: how many it did, how many were taken, and kinds of fault."""
    state, faults = mmap.mmap(-1, _STATE.size), mmap.mmap(-1, 8)
    child = os.fork()
    if not child:
        known: set[tuple] = set()
        work(kind, first, count, end, folder, state, known)
        faults[:] = struct.pack("<q", len(known))
        sys.stdout.flush()
        os._exit(0)
    seen, since = -1, time.monotonic()
    while not (found := os.waitpid(child, os.WNOHANG))[0]:
        done = _STATE.unpack(state[:])[0]
        if done != seen:
            seen, since = done, time.monotonic()
        elif time.monotonic() - since > HANGS:
            os.kill(child, signal.SIGKILL)
        time.sleep(0.02)
    done, taken = _STATE.unpack(state[:])
    kinds = struct.unpack("<q", faults[:])[0]
    if found[1]:
        why = "hangs" if os.WIFSIGNALED(found[1]) and os.WTERMSIG(found[1]) == signal.SIGKILL else f"ended, {found[1]}"
        print(f"{kind}, seed {first + done}: {why}", flush=True)
        return done + 1, taken, kinds + 1
    return done, taken, kinds


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
    fast = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None  # a disk would be most of the time
    faulty = False
    for kind in given.kinds or DRAWS:
        total = taken = kinds = 0
        start = time.monotonic()
        while total < given.count and time.monotonic() - start < given.seconds:
            with tempfile.TemporaryDirectory(prefix="fuzz-inputs-", dir=fast) as scratch:
                done = batch(kind, given.seed + total, min(AT_ONCE, given.count - total), start + given.seconds,
                             Path(scratch))  # fmt: skip
            total, taken, kinds = total + done[0], taken + done[1], kinds + done[2]
        faulty |= bool(kinds)
        print(f"{kind}: {total} drawn, {taken} taken, {kinds} faults, {time.monotonic() - start:.0f} s", flush=True)
    return int(faulty)


if __name__ == "__main__":
    raise SystemExit(main())
