"""Run random tests of many kinds in parallel processes within a time limit, and count their outcomes by kind.

Each batch is a process forked from one that has imported everything. It may be ended by a signal, or hang: that is a
fault of its seed, and another process continues after it. The kinds that need the least time go first, so that as many
as possible are finished in the given time. Needs `fork`.
"""

import mmap
import os
import shutil
import signal
import struct
import time
import traceback
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

OUTCOMES = ("read", "refused", "ended", "fault")
HANGS = 60.0  # [s] of one draw
GRACE = 5.0  # [s] that processes have to end by themselves when the time is over
A_BATCH, FIRST_BATCH, MOST = 4.0, 100, 50_000  # [s], draws; memory kept by libraries is freed with each process
_COUNTS = struct.Struct(f"<{len(OUTCOMES)}q")


class Report:
    """The outcomes of a batch, in memory shared with the process that started it."""

    def __init__(self, memory: mmap.mmap, faults: Path, end: float):
        """Write counts to `memory` and texts of faults to a file; it is late after `end`, by the monotonic clock."""
        self._memory, self._faults, self._end = memory, faults, end
        self._counts = dict.fromkeys(OUTCOMES, 0)

    def outcome(self, found: str) -> None:
        """Count one more finished draw."""
        self._counts[found] += 1
        self._memory[:] = _COUNTS.pack(*self._counts.values())

    def fault(self, seed: int, text: str) -> None:
        """Count one more finished draw as a fault."""
        with self._faults.open("a") as file:
            file.write(f"seed {seed}: {_short(text)}\n")
        self.outcome("fault")

    def late(self) -> bool:
        """Whether the time for all draws is over."""
        return time.monotonic() > self._end


Work = Callable[[str, range, Path, Report], None]
"""Runs the seeds of a kind in order, in an empty folder, and reports each; stops early when the report is late."""


def _short(text: str) -> str:
    """Shorten a text to one line: its beginning and its end, where a traceback names the error."""
    line = " ".join(text.split())
    return line if len(line) <= 600 else f"{line[:60]} ... {line[-500:]}"


class _Kind:
    """One kind: the seeds left to draw, the outcomes, and the time taken."""

    def __init__(self, name: str, seeds: range):
        self.name, self.left = name, [seeds]
        self.counts = dict.fromkeys(OUTCOMES, 0)
        self.seconds = 0.0  # of all its processes
        self.under_way = 0
        self.faults: list[str] = []

    @property
    def done(self) -> int:
        return sum(self.counts.values())

    @property
    def remaining(self) -> float:
        """Time of one process for the draws that have not been started [s]; 0 where it is not known."""
        return sum(map(len, self.left)) * self.seconds / self.done if self.done else 0.0

    def some(self) -> range:
        """The seeds of the next batch."""
        size = min(MOST, max(1, int(A_BATCH * self.done / self.seconds))) if self.done else FIRST_BATCH
        seeds = self.left.pop()
        if seeds[size:]:
            self.left.append(seeds[size:])
        return seeds[:size]


class _Batch:
    """A process that draws some seeds of a kind."""

    def __init__(self, kind: _Kind, work: Work, end: float, folder: Path):
        self.kind, self.seeds, self.folder = kind, kind.some(), folder
        self.memory = mmap.mmap(-1, _COUNTS.size)
        self.faults = folder / "faults"
        self.begun = self.heard = time.monotonic()
        self.seen = 0
        kind.under_way += 1
        (folder / "scratch").mkdir(parents=True)
        self.process = os.fork()
        if not self.process:
            os.setsid()  # so that it can be ended together with the processes that it starts
            try:
                work(kind.name, self.seeds, folder / "scratch", Report(self.memory, self.faults, end))
                os._exit(0)
            except BaseException:
                with self.faults.open("a") as file:
                    file.write(_short(traceback.format_exc()) + "\n")
                os._exit(1)

    def counts(self) -> dict[str, int]:
        return dict(zip(OUTCOMES, _COUNTS.unpack(self.memory[:]), strict=True))

    def kill(self) -> None:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.process, signal.SIGKILL)

    def over(self, late: bool) -> bool:
        """Whether the process has ended; then add its counts to its kind, and put back the seeds after a fatal one."""
        now = time.monotonic()
        status = os.waitpid(self.process, os.WNOHANG)
        counts = self.counts()
        if not status[0]:
            if sum(counts.values()) != self.seen:
                self.seen, self.heard = sum(counts.values()), now
            elif now - self.heard > HANGS:
                self.kill()
            return False
        self.kill()  # end processes that it left running
        kind, done = self.kind, sum(counts.values())
        kind.under_way -= 1
        kind.seconds += now - self.begun
        if self.faults.exists():
            kind.faults += self.faults.read_text().splitlines()
        for name, count in counts.items():
            kind.counts[name] += count
        if status[1] and not late:
            how = "hangs" if now - self.heard > HANGS else f"ended with status {status[1]}"
            kind.faults.append(f"seed {self.seeds[done]}: {how}")
            kind.counts["fault"] += 1
            kind.left.append(self.seeds[done + 1 :])
        elif not late:
            kind.left.append(self.seeds[done:])
        kind.left = [seeds for seeds in kind.left if seeds]
        shutil.rmtree(self.folder, ignore_errors=True)
        return True


def share(
    work: Work, kinds: Iterable[str], seeds: range, processes: int, seconds: float, scratch: Path
) -> dict[str, list[str]]:
    """Draw the seeds of every kind, print each fault when it is found and a table at the end; return faults by kind.

    Args:
        work: Function that draws.
        kinds: Names of the kinds.
        seeds: The seeds, the same for every kind.
        processes: Number of parallel processes.
        seconds: Time after which no more is drawn.
        scratch: A folder for temporary files.
    """
    every = [_Kind(name, seeds) for name in kinds]
    begun = time.monotonic()
    end, batches, number = begun + seconds, list[_Batch](), 0
    printed = dict.fromkeys((kind.name for kind in every), 0)
    try:
        while True:
            late = time.monotonic() > end
            batches = [batch for batch in batches if not batch.over(late)]
            for kind in every:
                for text in kind.faults[printed[kind.name] :]:
                    print(f"{kind.name}, {text}", flush=True)
                printed[kind.name] = len(kind.faults)
            # A kind that has not been drawn yet is tried by one process first, to measure its time.
            waiting = [kind for kind in every if kind.left and (kind.done or not kind.under_way)]
            if (not waiting or late) and not batches:
                break
            if late and time.monotonic() > end + GRACE:
                for batch in batches:
                    batch.kill()
            while waiting and not late and len(batches) < processes:
                kind = min(waiting, key=lambda kind: kind.remaining)
                batches.append(_Batch(kind, work, end, scratch / str(number)))
                number += 1
                waiting = [kind for kind in waiting if kind.left and (kind.done or not kind.under_way)]
            time.sleep(0.01)
    finally:
        for batch in batches:
            batch.kill()
            with suppress(ChildProcessError):
                os.waitpid(batch.process, 0)
    print(f"{'kind':26s}{'drawn':>9s}{'refused':>9s}{'read':>9s}{'ended':>7s}{'faults':>7s}{'ms each':>9s}")
    for kind in every:
        each = f"{1e3 * kind.seconds / kind.done:9.3g}" if kind.done else f"{'-':>9s}"
        read, refused, ended, faults = kind.counts.values()
        print(f"{kind.name:26s}{kind.done:9d}{refused:9d}{read:9d}{ended:7d}{faults:7d}{each}")
    print(f"{processes} processes, {time.monotonic() - begun:.0f} s, seeds from {seeds.start}", flush=True)
    return {kind.name: kind.faults for kind in every}
