"""Mixed runs in one process, hour after hour: memory and open handles must stay flat.

Each run is a whole one, as a user's: a Strehl ratio, an echo, a picture, a far field, a series into a store, a
recording from a pseudo-terminal, an export, a report. After each the process rests, so that it takes no more than its
share of a core. Once a minute the resident memory, the open handles and the threads are noted.

A leak shows as a slope. The least-squares slope of memory over the second half is given with its standard error; what
is filled once (kernels, splines, SQLite's pages) is full by then.
"""

import os
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ..hardware.export import export
from ..hardware.frames import encode
from ..hardware.port import open_port
from ..hardware.pseudo_terminal import PseudoTerminal
from ..hardware.recorder import Recorder
from ..hardware.sources import FrameStream
from ..hardware.store import EchoStore
from ..jobs.run import simulate, write_run
from ..pupils import Disc
from ..scene import Scene
from ..schlieren.knife_edge import schlieren
from ..strehl_estimate import estimate_strehl
from ..wavefront.traced import wavefront
from .recording.line import made_frames

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
    """What the process held at one moment.

    Attributes:
        minute: Time since the beginning [min].
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
    """Look at this process, by /proc; `since` is a time.monotonic."""
    status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
    numbers = dict(line.split(":", 1) for line in status.splitlines())
    memory, threads = int(numbers["VmRSS"].split()[0]) / 1024.0, int(numbers["Threads"])
    return Reading((time.monotonic() - since) / 60.0, runs, memory, len(os.listdir("/proc/self/fd")), threads)


def kinds(folder: Path, backends: tuple[str, ...]) -> dict[str, Callable[[], object]]:
    """The runs by name; `folder` takes what they write."""
    scene = Scene.load("wind-tunnel-mach3", SMALL)
    prepared: list = []

    def field():
        from ..prepare import prepare_field

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

    from ..flow import open_series
    from ..series import optical_series, statistics

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
    """Run one kind after the other for so long; a reading, and how often each kind ran, once a minute.

    Args:
        minutes: How long [min].
        share: Of one core that it may take on average.
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
    """Slope of the least-squares line [1/min] and its standard error; NaN from fewer than three readings."""
    if len(minute) < 3:
        return float("nan"), float("nan")
    off = minute - minute.mean()
    found = float(off @ value / (off @ off))
    rest = value - value.mean() - found * off
    return found, float(np.sqrt(rest @ rest / (len(minute) - 2) / (off @ off)))
