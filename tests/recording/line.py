"""Connect a part of the soak test to a recorder in a process of its own, and read what the store contains."""

import re
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aerokernels.hardware.frames import DELIMITER, EchoFrame, encode


@dataclass(frozen=True)
class Outcome:
    """Whether a part of the test passed, and its figures."""

    good: bool
    text: str


class RecorderProcess:
    """`aerokernels record` in a process of its own; its output is collected as it comes."""

    def __init__(self, port: Path, store: Path, *options: object, prepare: Callable[[], None] | None = None) -> None:
        """Start the recorder; `prepare` runs in the new process first."""
        command = [sys.executable, "-m", "aerokernels", "record", "--port", port, "--store", store, *options]
        self.process = subprocess.Popen(
            list(map(str, command)),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            preexec_fn=prepare,
        )
        self.lines: list[str] = []
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.append(line)

    def acknowledged(self) -> list[tuple[int, int]]:
        """(stored, last sequence) of every line so far."""
        return [
            (int(count), int(last))
            for line in self.lines
            for count, last in re.findall(r"stored (\d+), last sequence (\d+)", line)
        ]

    def wait(self, timeout: float) -> str:
        """Return the last line of output; kill the recorder if it does not end in time."""
        try:
            self.process.wait(timeout)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._thread.join(10.0)
        return self.lines[-1].strip() if self.lines else ""


def wait_for_reader(recorder: RecorderProcess, opened: int = 1) -> None:
    """Wait until the recorder has opened the port `opened` times; data sent after that is read."""
    while not any(_has_opened(line, opened) for line in list(recorder.lines)):
        if recorder.process.poll() is not None:
            raise RuntimeError(f"the recorder ended: {recorder.lines[-1:]}")
        time.sleep(0.01)


def _has_opened(line: str, times: int) -> bool:
    if times == 1:
        return line.startswith("recording ")
    return f"reconnected {times - 1}, port open" in line


def made_frames(count: int, sample_count: int = 128, first: int = 0, period_us: int = 20_000) -> list[EchoFrame]:
    """Frames whose samples are noise determined by their number."""
    noise = np.random.default_rng(1).integers(-3000, 3000, (512, sample_count)).astype(np.int16)
    return [
        EchoFrame(k % 2**32, period_us * k, 250, 1e-3, 0.0, noise[k % len(noise)] ^ np.int16(k % 1021))
        for k in range(first, first + count)
    ]


def damaged_line(frames: list[EchoFrame], rate: float, seed: int) -> tuple[bytes, list[int], int]:
    """Bytes of frames of which `rate` each are torn, flipped, glued or behind garbage; the good ones; damaged ones."""
    random, kinds = np.random.default_rng(seed), ("torn", "flipped", "glued", "garbage")
    wire, good, piece_count, follows_glued = bytearray(), [], 0, False
    for frame in frames:
        place = int(random.random() / rate)
        fault = kinds[place] if place < len(kinds) and not follows_glued and frame is not frames[-1] else None
        sent = encode(frame)
        if fault == "torn":
            sent = sent[: random.integers(1, len(sent) - 1)] + DELIMITER
        elif fault == "flipped":
            k = random.integers(len(sent) - 1)
            sent = sent[:k] + bytes([sent[k] ^ (1 if sent[k] != 1 else 2)]) + sent[k + 1 :]  # 0 would split the frame
        elif fault == "glued":
            sent = sent[:-1]
        elif fault == "garbage":
            wire += random.integers(1, 256, 50).astype(np.uint8).tobytes() + DELIMITER
        wire += sent
        piece_count += fault is not None
        if fault in (None, "garbage") and not follows_glued:
            good.append(frame.sequence)
        follows_glued = fault == "glued"
    return bytes(wire), good, piece_count


def stored(path: Path) -> dict[int, bytes]:
    """Samples by sequence number."""
    with closing(sqlite3.connect(path)) as connection:
        return dict(connection.execute("SELECT sequence, samples FROM echoes ORDER BY id"))


def counts(path: Path) -> tuple[int, int, int]:
    """Number of echoes, of damaged pieces, and of missing sequence numbers."""
    with closing(sqlite3.connect(path)) as connection:
        return connection.execute(
            "SELECT (SELECT count(*) FROM echoes), (SELECT count(*) FROM damaged), "
            "(SELECT coalesce(sum(missing_count), 0) FROM gaps)"
        ).fetchone()


def is_whole(path: Path) -> bool:
    """Whether SQLite finds the file intact."""
    with closing(sqlite3.connect(path)) as connection:
        return connection.execute("PRAGMA integrity_check").fetchone()[0] == "ok"
