"""Repeat mixed runs in one process, and measure the slopes of memory, handles and threads.

Each run is a complete one, as a user's: a Strehl ratio, an echo, a picture, a far field, a series into a store, a
recording from a pseudo-terminal, an export, a report. After each the process rests, so that it takes no more than its
fraction of a core. Once a minute the resident memory, the open handles and the threads are recorded.

A leak shows as a slope. The least-squares slope of memory over the second half is printed with its standard error;
caches that are filled once (kernels, splines, SQLite's pages) are full by then.

Exit status 0 if memory grows by less than 0.1 MiB a minute, beyond twice its standard error, in the second half, and
no handle or thread is left behind. Needs Linux's /proc.
"""

import argparse
import csv
import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass, fields
from functools import partial
from pathlib import Path

import numpy as np

from aerokernels.hardware.export import export
from aerokernels.hardware.frames import encode
from aerokernels.hardware.port import open_port
from aerokernels.hardware.pseudo_terminal import PseudoTerminal
from aerokernels.hardware.recorder import Recorder
from aerokernels.hardware.sources import FrameStream
from aerokernels.hardware.store import EchoStore
from aerokernels.jobs.run import simulate, write_run
from aerokernels.pupils import Disc
from aerokernels.scene import Scene
from aerokernels.schlieren.knife_edge import schlieren
from aerokernels.strehl.estimate import estimate_strehl
from aerokernels.tracing import available_backends
from aerokernels.validation.report import markdown_table
from aerokernels.wavefront.traced import wavefront
from tests.recording.line import made_frames

GREATEST_SLOPE = 0.1  # [MiB/min]: 144 MiB a day
RECORDED = 200  # echoes of one recording
SMALL = {
    "grid.spacing": 4e-4,
    "strehl.ray_count": 160,
    "beam.ray_count": 25,
    "receiver.ray_count": 64,
    "trace.backend": "warp",
    "trace.device": "cpu",
}


@dataclass(frozen=True)
class Reading:
    """The process's resources at one moment.

    Attributes:
        minute: Time since the start [min].
        runs: Runs finished by then.
        memory: Resident memory [MiB].
        handles: Open file descriptors.
        threads: Threads.
    """

    minute: float
    runs: int
    memory: float
    handles: int
    threads: int


def reading(since: float, runs: int) -> Reading:
    """Read this process's resources from /proc; `since` is a time.monotonic."""
    status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
    numbers = dict(line.split(":", 1) for line in status.splitlines())
    memory, threads = int(numbers["VmRSS"].split()[0]) / 1024.0, int(numbers["Threads"])
    return Reading((time.monotonic() - since) / 60.0, runs, memory, len(os.listdir("/proc/self/fd")), threads)


def kinds(folder: Path, backends: tuple[str, ...]) -> dict[str, Callable[[], object]]:
    """Return the runs by name; they write to `folder`."""
    scene = Scene.load("wind-tunnel-mach3", SMALL)
    prepared: list = []

    def field():
        from aerokernels.prepare import prepare_field

        if not prepared:
            prepared.append(prepare_field(scene).field)
        return prepared[0]

    def strehl(backend: str) -> object:
        return estimate_strehl(field(), scene.view, ray_count=1000, backend=backend, allow_truncation=True)

    found: dict[str, Callable[[], object]] = {f"strehl, {backend}": partial(strehl, backend) for backend in backends}
    return found | {
        "run": lambda: write_run(simulate(scene), folder / "run"),
        "schlieren": lambda: schlieren(field(), pixel_count=16, backend="warp", device="cpu"),
        "wavefront and psf": lambda: wavefront(
            field(), scene.view, pixel_count=24, backend="warp", device="cpu", allow_truncation=True
        ).psf(),
        "series": lambda: _series(folder),
        "recording and export": lambda: _recording(folder),
    }


def _series(folder: Path) -> None:
    import shutil

    from aerokernels.flow import open_series
    from aerokernels.series import optical_series, statistics

    x = np.linspace(-0.05, 0.05, 9)
    rho = [1.2 + 0.01 * np.cos(60 * x[:, None, None] + k + 0 * x[None, :, None] + 0 * x) for k in range(8)]
    series = open_series(rho, time=np.arange(8) * 1e-5, geometry="volume", origin=(-0.05, -0.05, -0.05),
                         spacing=[0.0125] * 3, ambient_density=1.2)  # fmt: skip
    out = folder / "maps.zarr"
    for old in (out, folder / ".maps.zarr.journal"):
        if old.is_dir():
            shutil.rmtree(old)
        old.unlink(missing_ok=True)
    maps = optical_series(series, Disc(0.02, (0.0, 0.0, -0.05)), pixel_count=12, backend="warp", device="cpu", out=out)
    statistics(maps, mode_count=2)
    maps.close()


def _recording(folder: Path) -> None:
    path, link = folder / "echoes.sqlite", folder / "port"
    path.unlink(missing_ok=True)
    with PseudoTerminal(link) as terminal, EchoStore(path) as store:
        store.begin_recording(str(link), "frames", {"mach": "3"})
        stream = FrameStream(open_port(str(link)))
        wire = b"".join(map(encode, made_frames(RECORDED)))
        sender = threading.Thread(target=terminal.write, args=(wire,))
        sender.start()
        status = Recorder(
            stream, store, lambda: FrameStream(open_port(str(link))), count=RECORDED, stall_time=20.0
        ).run()
        sender.join()
    if status.stored_count != RECORDED:
        raise RuntimeError(f"{status.stored_count} of {RECORDED} echoes were stored")
    with EchoStore(path, read_only=True) as store:
        for name in ("echoes.nc", "echoes.csv"):
            export(store, folder / name)


def soak(minutes: float, share: float, backends: tuple[str, ...]) -> Iterator[tuple[Reading, dict[str, int]]]:
    """Repeat all kinds of run for so long; yield a reading, and how often each kind ran, once a minute.

    Args:
        minutes: How long [min].
        share: Greatest average fraction of one core to use.
        backends: Of "warp" and "opencl": those whose Strehl ratios are among the runs.
    """
    begin, counts, next_look = time.monotonic(), {}, 0.0
    with tempfile.TemporaryDirectory(prefix="soak-") as folder:
        runs = kinds(Path(folder), backends)
        counts = dict.fromkeys(runs, 0)
        while time.monotonic() - begin < 60.0 * minutes:
            for name, run in runs.items():
                busy = time.process_time()
                run()
                counts[name] += 1
                rest_until = time.monotonic() + (time.process_time() - busy) * (1.0 / share - 1.0)
                while True:
                    if time.monotonic() - begin >= next_look:
                        yield reading(begin, sum(counts.values())), dict(counts)
                        next_look = max(next_look + 60.0, time.monotonic() - begin)  # a run may take minutes
                    left = rest_until - time.monotonic()
                    if left <= 0.0:
                        break
                    time.sleep(min(left, 1.0))
        yield reading(begin, sum(counts.values())), dict(counts)


def slope(minute: np.ndarray, value: np.ndarray) -> tuple[float, float]:
    """Return the slope of the least-squares line [1/min] and its standard error; NaN from fewer than three readings."""
    if len(minute) < 3:
        return float("nan"), float("nan")
    off = minute - minute.mean()
    found = float(off @ value / (off @ off))
    rest = value - value.mean() - found * off
    return found, float(np.sqrt(rest @ rest / (len(minute) - 2) / (off @ off)))


def main() -> int:
    """Run for the requested time, and print the slopes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=120.0, help="how long")
    parser.add_argument("--share", type=float, default=0.15, help="of one core, at most on average")
    parser.add_argument("--out", type=Path, help="folder for readings.csv and table.md [default: print only]")
    given = parser.parse_args()
    if not Path("/proc/self/status").exists():
        parser.error("there is no /proc here: run this on Linux")
    os.nice(19)
    there = {way.backend for way in available_backends() if way.available}
    backends = tuple(name for name in ("warp", "opencl") if name in there)
    readings: list[Reading] = []
    counts: dict[str, int] = {}
    for found, counted in soak(given.minutes, given.share, backends):
        counts = counted
        readings.append(found)
        print(f"{found.minute:6.1f} min, {found.runs} runs: {found.memory:.1f} MiB, {found.handles} handles, "
              f"{found.threads} threads", flush=True)  # fmt: skip
    table = np.array([astuple(one) for one in readings])
    late = table[len(table) // 2 :]
    rows, good = [], True
    for name, column, unit in (("memory", 2, "MiB"), ("handles", 3, ""), ("threads", 4, "")):
        rise, error = slope(late[:, 0], late[:, column])
        if column == 2:
            fine = not rise - 2.0 * error > GREATEST_SLOPE
        else:
            fine = late[-1, column] <= late[:, column].min() + 1
        fine = bool(fine)
        good &= fine
        ends = (f"{value:.1f} {unit}".strip() for value in (table[0, column], late[0, column], late[-1, column]))
        rows.append(
            (name, *ends, f"{rise:+.3f} +- {error:.3f} {unit}/min".replace(" /", " 1/"), "flat" * fine or "GROWS")
        )
    text = markdown_table(("", "first", "at half time", "last", "slope of the second half", ""), rows, text_columns=6)
    ran = ", ".join(f"{name} {count}" for name, count in counts.items())
    print(text + f"\n{readings[-1].runs} runs in {readings[-1].minute:.0f} min: {ran}")
    if given.out:
        given.out.mkdir(parents=True, exist_ok=True)
        (given.out / "table.md").write_text(text, encoding="utf-8")
        with (given.out / "readings.csv").open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([[field.name for field in fields(Reading)], *map(astuple, readings)])
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
