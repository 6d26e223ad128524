"""Compute ten thousand small snapshots into a store on disk: memory, speed, and a run that is killed repeatedly.

The snapshots are frames of a frozen random field, made when they are needed. A process computes them and is killed
without warning every few seconds; each new process continues. The result is compared, byte by byte, with the store of a
process that was not killed, and that process's memory is read at every hundredth snapshot.
"""

import argparse
import hashlib
import json
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow import Series, open_series
from aerokernels.pupils import Disc
from aerokernels.series import optical_series
from aerokernels.validation.fourier_fields import Fourier

SHAPE, SPACING, ORIGIN = (25, 25, 13), 4e-3, (-0.048, -0.048, 0.0)
EVERY = 100  # snapshots between two readings of the memory


class Frames:
    """The snapshots of a frozen field by their number, each made when it is needed."""

    def __init__(self, count: int):
        """Describe `count` frames, 1 us apart."""
        self.count, self.field = count, Fourier.random(11)

    def __len__(self) -> int:
        """Return the number of frames."""
        return self.count

    def __getitem__(self, number: int) -> np.ndarray:
        """Return one frame."""
        if not 0 <= number < self.count:
            raise IndexError(number)
        return self.field.on_grid(ORIGIN, SPACING, SHAPE, 1e-6 * number, np.float32)


def opened(count: int) -> Series:
    """Return the series."""
    return open_series(
        Frames(count),
        time_step=1e-6,
        geometry="volume",
        origin=ORIGIN,
        spacing=[SPACING] * 3,
        ambient_density=0.5,
    )


def resident() -> int:
    """Return this process's resident memory [bytes], or its peak if the system does not report the former."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return pages * resource.getpagesize()


def compute(count: int, out: Path) -> dict[str, Any]:
    """Compute the series into a store; return the memory at every hundredth snapshot, and seconds."""
    held: list[int] = []
    begin = time.perf_counter()

    def look(text: str, share: float) -> None:
        if round(share * count) % EVERY == 0:
            held.append(resident())

    optical_series(opened(count), Disc(0.03, [0.0, 0.0, -0.01]), pixel_count=16, out=out, progress=look)
    return {"resident": held, "seconds": time.perf_counter() - begin}


def digest(store: Path) -> str:
    """Return a hash of all files of a store and their contents."""
    found = hashlib.sha256()
    for path in sorted(one for one in store.rglob("*") if one.is_file()):
        found.update(str(path.relative_to(store)).encode() + b"\0" + path.read_bytes())
    return found.hexdigest()


def _begin(count: int, out: Path) -> subprocess.Popen:
    """Start this program in a process that computes the series into a store and prints the result of `compute`."""
    program = [sys.executable, str(Path(__file__).resolve()), "--alone", "--count", str(count), "--out", str(out)]
    return subprocess.Popen(program, stdout=subprocess.PIPE, encoding="utf-8")


def _journal(out: Path) -> int:
    path = out.with_name(f".{out.name}.journal")
    return path.read_bytes().count(b"\n") - 1 if path.is_file() else 0


def measure(count: int, folder: Path, kills: int, seed: int = 0) -> dict[str, Any]:
    """Run both processes, and compare their stores.

    Args:
        count: Number of snapshots.
        folder: Folder in which both stores are made anew.
        kills: How often the second process is killed.
        seed: Seed of the moments at which it is killed.
    """
    draw = random.Random(seed)
    for name in ("whole.zarr", "broken.zarr"):
        shutil.rmtree(folder / name, ignore_errors=True)
        (folder / f".{name}.journal").unlink(missing_ok=True)
    folder.mkdir(parents=True, exist_ok=True)
    whole, broken = folder / "whole.zarr", folder / "broken.zarr"
    alone = _begin(count, whole)
    output = alone.communicate()[0]
    if alone.returncode:
        raise RuntimeError(f"the process left alone ended with exit status {alone.returncode}")
    found = json.loads(output)
    moments = sorted(draw.randrange(1, count) for _ in range(kills))
    killed = []
    for moment in moments:
        process = _begin(count, broken)
        while process.poll() is None and _journal(broken) < moment:
            time.sleep(draw.uniform(0.0, 0.01))
        process.send_signal(signal.SIGKILL)
        process.communicate()
        killed.append(_journal(broken))
    last = _begin(count, broken)
    last.communicate()
    return {
        "snapshots": count,
        "per_second": count / found["seconds"],
        "resident_bytes": found["resident"],
        "killed_at": killed,
        "same": last.returncode == 0 and digest(whole) == digest(broken),
    }


def main() -> None:
    """Measure, and print the result."""
    parser = argparse.ArgumentParser(prog="scripts/long_series", description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=10_000, help="snapshots")
    parser.add_argument("--kills", type=int, default=5, metavar="COUNT", help="how often the second run is killed")
    parser.add_argument("--out", type=Path, help="keep the stores in this folder")
    parser.add_argument("--alone", action="store_true", help="compute the series into the store --out, and no more")
    options = parser.parse_args()
    if options.count < 2 or options.kills < 0:
        parser.error("--count must be at least 2, and --kills at least 0")
    if options.alone:
        print(json.dumps(compute(options.count, options.out)))
        return
    with tempfile.TemporaryDirectory() as folder:
        found = measure(options.count, options.out or Path(folder), options.kills)
    print(f"{found['snapshots']} snapshots, {found['per_second']:.0f} a second")
    held = [round(one / 2**20, 1) for one in found["resident_bytes"]]
    if held:
        step = max(1, len(held) // 10)
        print(f"memory [MiB] at every {step * EVERY} snapshots: {', '.join(map(str, held[step - 1 :: step]))}")
    print(f"killed at {found['killed_at']}; then the same as the run left alone: {found['same']}")
    if not found["same"]:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
