"""Kill commands at random times, and run two at once in the same place: results must be whole and never mixed.

Each command runs in its own process, as a user's would. Before a kill there is an earlier result, and the killed
command would write another: afterwards one of the two must be there, whole. Of two commands at once, one succeeds; the
other waits, or ends with exit status 2 and one line. Exit status 1 if anything else happens.
"""

import argparse
import hashlib
import json
import os
import pty
import random
import select
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from contextlib import closing, suppress
from pathlib import Path

import numpy as np
import xarray

from aerokernels.hardware.frames import EchoFrame
from aerokernels.hardware.store import EchoStore
from aerokernels.jobs.run_folder import finish_moving
from aerokernels.validation.report import markdown_table

SMALL = [part for setting in ("grid.spacing=0.4 mm", "strehl.ray_count=160", "beam.ray_count=25",
                              "receiver.ray_count=64", "trace.backend=warp", "trace.device=cpu")
         for part in ("--set", setting)]  # fmt: skip
SERIES = '[series]\nsource = "layer.nc"\npixel_count = 12\n[receiver]\ndiameter = "30 mm"\naperture_z = "2 mm"\n'
ECHOES = 300
AT_WORK, IN_USE = "another process is at work there", "in use by another process"


def command(kind: str, variant: int, out: str) -> list[str]:
    """Return the arguments of a command; variants of one kind write different results."""
    return {
        "run": ["run", "wind-tunnel-mach3", *SMALL, "--set", f"target.tilt={variant} deg", "--out", out],
        "schlieren": ["schlieren", "mach3", "--pixels", str(16 + 8 * variant), "--spacing", "1 mm",
                      "--kind", "schlieren", "--backend", "warp", "--device", "cpu", "--out", out],
        "sweep": ["sweep", "wind-tunnel-mach3", *SMALL, "--vary", f"target.tilt=0 deg,{variant} deg",
                  "--workers", "1", "--out", out],
        "dask": ["sweep", "wind-tunnel-mach3", *SMALL, "--vary", f"target.tilt=0 deg,{variant} deg",
                 "--executor", "dask", "--workers", "2", "--out", out],
        "series": ["series", "layer.toml", "--set", f"series.pixel_count={8 + variant}", "--out", out],
        "export": ["export", "echoes.sqlite", "--label", f"variant={variant}", "--out", f"{out}.nc"],
        "record": ["record", "--port", "board0", "--store", f"{out}.sqlite", "--count", "50"],
    }[kind]  # fmt: skip


def started(folder: Path, *arguments: str) -> subprocess.Popen:
    """Start a command."""
    return subprocess.Popen([sys.executable, "-m", "aerokernels", *arguments], cwd=folder, encoding="utf-8",
                            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE)  # fmt: skip


def prepare(folder: Path) -> None:
    """Write the commands' input files."""
    axis = np.linspace(-0.02, 0.02, 11)
    density = 0.5 + 0.01 * np.random.default_rng(0).random((4, 11, 11, 11))
    data = xarray.Dataset({"rho": (("time", "x", "y", "z"), density)},
                          {"time": 1e-5 * np.arange(4), **{name: (name, axis) for name in "xyz"}},
                          {"ambient_density": 0.5})  # fmt: skip
    data.to_netcdf(folder / "layer.nc", engine="h5netcdf")
    (folder / "layer.toml").write_text(SERIES, encoding="utf-8")
    with EchoStore(folder / "echoes.sqlite") as store:
        for variant in range(1, 3):
            store.begin_recording("port", "frames", {"variant": str(variant)})
            for k in range(ECHOES):
                store.add(EchoFrame(k, 1000 * k, 250, 1e-3, 0.0, np.arange(500) * variant), k)
            store.commit()


def lying(place: Path) -> dict[str, str]:
    """Return a result's files with hashes of their contents, without hidden files."""
    if place.is_file():
        return {place.name: hashlib.sha256(place.read_bytes()).hexdigest()}
    finish_moving(place)  # as every reader of a folder does
    files = [path for path in sorted(place.rglob("*")) if path.is_file()]
    shown = [path for path in files if not any(part.startswith(".") for part in path.relative_to(place).parts)]
    return {str(path.relative_to(place)): hashlib.sha256(path.read_bytes()).hexdigest() for path in shown}


def kills(kind: str, folder: Path, count: int, draw: random.Random) -> str:
    """Kill a command `count` times at random times, and describe the outcome.

    Raises:
        AssertionError: A result is half-written.
    """
    place = folder / ("out.nc" if kind == "export" else "out")
    took = []
    for variant in (1, 2):  # the first compiles kernels, if need be
        begin = time.monotonic()
        _, said = (process := started(folder, *command(kind, variant, "out"))).communicate(timeout=600)
        assert process.returncode == 0, said
        took.append(time.monotonic() - begin)
    stayed = replaced = 0
    for number in range(count):
        before = lying(place)
        process = started(folder, *command(kind, 1 + number % 2, "out"))
        # Most of a command's time is Python's start; it writes near its end.
        time.sleep(took[1] * draw.triangular(0.2, 1.3, 0.95))
        process.kill()
        process.communicate()
        after = lying(place)
        assert after.keys() == before.keys(), (sorted(before), sorted(after))
        changed = sum(after[name] != before[name] for name in before)
        assert changed in (0, len(before)), f"{changed} of {len(before)} files are new"
        stayed, replaced = stayed + (not changed), replaced + bool(changed)
    process = started(folder, *command(kind, 1, "out"))
    process.communicate()
    assert process.returncode == 0
    left = [path.name for parent in {folder, place.parent, *([place] if place.is_dir() else [])}
            for path in parent.iterdir() if path.name.startswith(".")]  # fmt: skip
    assert not left, left
    return f"{count} kills: {stayed} times the earlier result, {replaced} times the new one"


def pairs(kind: str, folder: Path, count: int, draw: random.Random) -> str:
    """Start two of a kind at nearly the same time, so often; what came of it.

    Raises:
        AssertionError: Neither went through, or something is mixed, or the other does not say why in one line.
    """
    both = refused = 0
    for number in range(count):
        out = f"pair{number}" if number % 2 else "pair"  # every other time a result is there already
        place = folder / (f"{out}.nc" if kind == "export" else out)
        processes = []
        for variant in (1, 2):
            processes.append(started(folder, *command(kind, variant, out)))
            time.sleep(draw.choice((0.0, 0.02, 0.2, 1.0)))
        said = [process.communicate(timeout=600)[1] for process in processes]
        codes = [process.returncode for process in processes]
        assert 0 in codes and set(codes) <= {0, 2}, said
        for code, text in zip(codes, said, strict=True):
            errors = [line for line in text.splitlines() if line.startswith("error: ")]
            assert (code == 0) == (not errors) and len(errors) < 2 and "Traceback" not in text, text
            differs = kind in ("sweep", "series") and "it holds another" in text  # the first was done by then
            assert code == 0 or AT_WORK in text or IN_USE in text or differs, text
        both, refused = both + (codes == [0, 0]), refused + (2 in codes)
        if kind == "run":
            summary = json.loads((place / "summary.json").read_text(encoding="utf-8"))
            with xarray.open_dataset(place / "result.nc", engine="h5netcdf") as result:
                assert result.attrs["range_m"] == summary["range_m"]
        if kind == "export":
            with xarray.open_dataset(place, engine="h5netcdf") as result:
                assert result.sizes["echo"] == ECHOES and len(set(result["label_variant"].values)) == 1
        drafts = [path.name for path in folder.iterdir() if ".partial" in path.name or path.name.endswith(".lock")]
        assert not drafts, drafts
    return f"{count} pairs: {refused} times the other was refused, {both} times both went through"


def recorders(folder: Path, count: int, draw: random.Random) -> str:
    """Run two recorders of two boards into one store, and two of one board.

    Raises:
        AssertionError: An echo is missing or there twice, or the second recorder on one port does not say why it ends.
    """
    boards = [started(folder, "board", "--protocol", "frames", "--link", f"board{k}", "--rate", "400")
              for k in range(2)]  # fmt: skip
    refused = 0
    try:
        while not all((folder / f"board{k}").exists() for k in range(2)):
            time.sleep(0.1)
        for number in range(count):
            store = f"pair{number}.sqlite"
            ways = [["record", "--port", f"board{k}", "--store", store, "--count", "50"] for k in (0, 1, 0)]
            processes = []
            for way in ways:
                processes.append(started(folder, *way))
                time.sleep(draw.choice((0.0, 0.05)))
            said = [process.communicate(timeout=120)[1] for process in processes]
            codes = [process.returncode for process in processes]
            assert codes[1] == 0 and 0 in (codes[0], codes[2]) and set(codes) <= {0, 2}, (codes, said)
            assert all(code == 0 or (IN_USE in text and text.count("\n") == 1)
                       for code, text in zip(codes, said, strict=True)), said  # fmt: skip
            refused += 2 in codes
            with closing(sqlite3.connect(folder / store)) as opened:
                rows = opened.execute("SELECT recording, sequence FROM echoes").fetchall()
            assert len(rows) == len(set(rows)) == 50 * codes.count(0), len(rows)
    finally:
        for board in boards:
            board.terminate()
            board.communicate()
    return f"{count} times 3 recorders: two boards into one store, every echo once; on one port {refused} refused"


def on_a_terminal(folder: Path, arguments: list[str], name: str, delay: float) -> tuple[int, str]:
    """Run a command on its own terminal and stop it after a while; return its status, and its output.

    SIGINT is sent as the terminal's Ctrl-C, SIGHUP by closing the terminal.
    """
    process, terminal = pty.fork()
    if not process:
        os.chdir(folder)
        os.execv(sys.executable, [sys.executable, "-m", "aerokernels", *arguments])
    said, end, stopped, status = b"", time.monotonic() + delay, False, None
    while status is None:
        if not stopped and time.monotonic() > end:
            stopped = True
            if name == "SIGINT":
                os.write(terminal, b"\x03")
            elif name == "SIGHUP":
                os.close(terminal)
            else:
                os.kill(process, getattr(signal, name))
        if not (stopped and name == "SIGHUP") and select.select([terminal], [], [], 0.01)[0]:
            with suppress(OSError):  # Linux raises it when the last writer has left
                said += os.read(terminal, 65536)
        ended, found = os.waitpid(process, os.WNOHANG)
        status = os.waitstatus_to_exitcode(found) if ended else None
        assert time.monotonic() < end + 120.0, "it does not end"
    if not (stopped and name == "SIGHUP"):
        with suppress(OSError):
            while more := os.read(terminal, 65536):
                said += more
        os.close(terminal)
    return status, said.decode("utf-8", "replace")


def progress(kind: str, folder: Path) -> int:
    """Return how much of a job is done and stored: cases, snapshots or echoes."""
    if kind == "record":
        if not (folder / "out.sqlite").exists():
            return 0
        with closing(sqlite3.connect(folder / "out.sqlite")) as opened:
            assert opened.execute("PRAGMA integrity_check").fetchone() == ("ok",)
            rows = opened.execute("SELECT recording, sequence FROM echoes").fetchall()
            assert len(rows) == len(set(rows))
            return len(rows)
    kept = (
        folder
        / "out"
        / {"sweep": "cases.jsonl", "dask": "cases.jsonl", "series": ".series.zarr.journal"}.get(kind, "summary.json")
    )
    return kept.read_bytes().count(b"\n") if kept.exists() else 0


def signals(kind: str, folder: Path, count: int, draw: random.Random) -> str:
    """Stop a job by a signal at random times until it is done, then start again; describe the outcome.

    Raises:
        AssertionError: Another status than the signal's, a traceback, something half-written, or finished work is lost.
    """
    ways = {"SIGINT": 130, "SIGTERM": 143, "SIGHUP": 129, "SIGKILL": -9}
    more = {
        "record": ["--count", "100000"],
        **{name: ["--vary", "target.distance=1 m:2 m:8"] for name in ("sweep", "dask")},
    }
    arguments = [*command(kind, 1, "out"), *more.get(kind, [])]
    board = None
    if kind == "record":
        board = started(folder, "board", "--protocol", "frames", "--link", "board0", "--rate", "400")
        while not (folder / "board0").exists():
            time.sleep(0.05)
        took = 5.0
    else:
        for _ in range(2):  # the first compiles kernels, if need be
            begin = time.monotonic()
            _, said = (process := started(folder, *arguments)).communicate(timeout=600)
            assert process.returncode == 0, said
            took = time.monotonic() - begin
            shutil.rmtree(folder / "out")
    done = stopped = before = 0
    try:
        for number in range(count):
            name = list(ways)[number % 4]
            status, said = on_a_terminal(folder, arguments, name, took * draw.triangular(0.05, 1.1, 0.8))
            early = status == -getattr(signal, name)  # while Python was still starting
            right = status == 0 or early or status == ways[name]
            told = sum(word in line for line in said.splitlines() for word in ("error:", "interrupted"))
            assert right and "Traceback" not in said and told <= 1, (
                name,
                status,
                said[-300:],
            )
            now = progress(kind, folder)
            assert now >= before, f"{before - now} of what was done is lost"
            drafts = [path.name for path in folder.rglob("*") if ".partial" in path.name]
            assert name == "SIGKILL" or not drafts, drafts
            before, done, stopped = now, done + (status == 0), stopped + (status != 0)
            if status == 0 and kind != "record":
                shutil.rmtree(folder / "out")
                before = 0
    finally:
        if board is not None:
            board.terminate()
            board.communicate()
    return f"{count} signals: {stopped} times stopped in time, {done} times done by then; nothing done was lost"


def main() -> int:
    """Run the requested tests."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--kills", type=int, default=20, help="of schlieren, run and export each")
    parser.add_argument("--pairs", type=int, default=6, help="of each command")
    parser.add_argument("--signals", type=int, default=12, help="to run, sweep, sweep on Dask, series and record each")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", help="commands, such as schlieren [default: all]")
    given = parser.parse_args()
    draw, rows, good = random.Random(given.seed), [], True
    jobs = [(f"{kind}, killed", kills, (kind,), given.kills) for kind in ("schlieren", "run", "export")]
    jobs += [(f"{kind}, two at once", pairs, (kind,), given.pairs)
             for kind in ("run", "schlieren", "sweep", "series", "export")]  # fmt: skip
    jobs.append(("record, three at once", recorders, (), given.pairs))
    jobs += [(f"{kind}, signals", signals, (kind,), given.signals)
             for kind in ("run", "sweep", "dask", "series", "record")]  # fmt: skip
    for name, work, arguments, count in jobs:
        if not count or (given.only and name.split(",")[0] not in given.only):
            continue
        with tempfile.TemporaryDirectory(prefix="kills-") as scratch:
            prepare(Path(scratch))
            try:
                text = work(*arguments, Path(scratch), count, draw)
            except AssertionError as fault:
                good, text = False, f"FAILED: {fault}"
        print(f"{name}: {text}", flush=True)
        rows.append((name, text))
    print(markdown_table(("what", "what came of it"), rows, text_columns=2))
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
