"""Parts of the soak test under load: 2 MB/s for some time, and hours of echoes in minutes."""

import os
import threading
import time
from pathlib import Path

from aerokernels.hardware.frames import encode
from aerokernels.hardware.simulator import PseudoTerminal

from .line import Outcome, RecorderProcess, counts, is_whole, made_frames, wait_for_reader

RATE = 2e6  # [byte/s]
ECHO_RATE = 50.0  # [1/s]
_CHUNK = 2048  # frames made at a time


def throughput(folder: Path, size: float) -> Outcome:
    """Send 2 MB/s for `size` seconds to a recorder confined to one core; then as fast as it reads."""
    wire = [encode(frame) for frame in made_frames(_CHUNK, 512)]
    length = sum(map(len, wire)) / len(wire)
    count = int(size * RATE / length)
    texts, fine = [], True
    for paced in (True, False):
        link, path = folder / "port", folder / f"echoes-{paced}.sqlite"
        with PseudoTerminal(link) as terminal:
            recorder = RecorderProcess(link, path, "--count", count, prepare=_on_one_core)
            wait_for_reader(recorder)
            busy = _cpu_seconds(recorder.process.pid)
            start, sent, behind = time.perf_counter(), 0, 0.0
            for first in range(0, count, 32):
                frames = made_frames(min(32, count - first), 512, first)
                if paced:
                    ahead = sent / RATE - (time.perf_counter() - start)
                    time.sleep(max(0.0, ahead))
                    behind = max(behind, -ahead)
                data = b"".join(map(encode, frames))
                terminal.write(data)
                sent += len(data)
            took = time.perf_counter() - start
            busy = _cpu_seconds(recorder.process.pid) - busy
            recorder.wait(120.0)
        rows, damaged, missing = counts(path)
        fine &= (rows, damaged, missing) == (count, 0, 0) and is_whole(path)
        texts.append(
            f"{'paced' if paced else 'unpaced'}: {sent / took / 1e6:.2f} MB/s for {took:.1f} s, {rows} of {count} "
            f"frames stored, {damaged} damaged, {missing} missing, {100 * busy / took:.0f} % of a core"
            + (f", sender at most {1e3 * behind:.0f} ms behind" if paced else "")
        )
        path.unlink()
    return Outcome(fine, "; ".join(texts))


def long(folder: Path, size: float) -> Outcome:
    """Send `size` seconds of 50 echoes/s by the board's clock as fast as the line allows; memory must not grow."""
    link, path = folder / "port", folder / "echoes.sqlite"
    count = int(size * ECHO_RATE)
    memory: list[tuple[int, float]] = []
    with PseudoTerminal(link) as terminal:
        recorder = RecorderProcess(link, path, "--count", count)
        wait_for_reader(recorder)
        sent, done = 0, threading.Event()
        memory.append((0, _resident_mib(recorder.process.pid)))

        def watch() -> None:
            while not done.wait(0.25):
                memory.append((sent, _resident_mib(recorder.process.pid)))

        watcher = threading.Thread(target=watch)
        watcher.start()
        start = time.perf_counter()
        try:
            while sent < count:
                frames = made_frames(min(_CHUNK, count - sent), 128, sent, round(1e6 / ECHO_RATE))
                terminal.write(b"".join(map(encode, frames)))
                sent += len(frames)
        finally:
            done.set()
            watcher.join()
        took = time.perf_counter() - start
        recorder.wait(120.0)
    rows, damaged, missing = counts(path)
    early = max((use for at, use in memory if at <= 0.1 * count), default=0.0)
    late = max((use for at, use in memory if at > 0.1 * count), default=0.0)
    # Buffers and SQLite's cache fill at the beginning; a leak of 20 bytes an echo would show as 27 MiB in eight hours.
    fine = (rows, damaged, missing) == (count, 0, 0) and late < early + 24.0
    return Outcome(
        fine,
        f"{size / 3600:g} h at {ECHO_RATE:g}/s in {took:.0f} s: {rows} of {count} stored, {damaged} damaged, {missing} "
        f"missing; memory {early:.0f} MiB in the first tenth, {late:.0f} MiB after; "
        f"store {path.stat().st_size / 1e6:.0f} MB",
    )


def _on_one_core() -> None:
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


def _cpu_seconds(pid: int) -> float:
    """User and system time of a process [s]; 0 where there is no /proc."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _resident_mib(pid: int) -> float:
    """Resident memory of a process [MiB]; 0 where there is no /proc."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0.0
    return sum(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1024.0
