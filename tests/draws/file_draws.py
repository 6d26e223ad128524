"""Random files from outside: recorded echoes as CSV, NetCDF and stores, and records of interrupted jobs.

As in input_draws.py: an answer with finite numbers, or a refusal in one line that names the file.
"""

import csv
import io
import json
import random
import shutil
import sqlite3
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path

import numpy as np

from aerokernels.hardware.export import export
from aerokernels.hardware.frames import EchoFrame
from aerokernels.hardware.store import EchoStore, StoreError
from aerokernels.jobs.recorded import RecordedEcho, recorded_echoes, recorded_labels
from aerokernels.jobs.sweeps.records import CASES_FILE, DEFINITION_FILE, Records, read_definition

from .damaged_files import damaged
from .input_draws import Draw
from .refusals import check_refusal

SAMPLES = 20
CELLS = ("", "nan", "inf", "1e999", "-1", "abc", "=1+1", "'", '"', "1;2", "1,5", "\x00", "\x1b[2J", "٣", "9" * 400, "é")
COLUMNS = ("sequence", "device_time_us", "host_time_ns", "label", "sample_period_ps", "first_sample_s", "scale",
           "offset", "sample_count", "samples", "crc32", "preamble", "raw", "session", "flags")  # fmt: skip
STORED = (0, -1, 2**63 - 1, 1e300, float("inf"), "text", b"", b"\xff", b"\x00" * 3, b"\x01\x00" * 40, "[]", "{}",
          "null", '{"mach": 3}', '{"\\u001b[31m": "x"}', "[" * 3000, '{"a": {"b": [1]}}', "١", None)  # fmt: skip


def check_echoes(echoes: Iterable[RecordedEcho]) -> bool:
    """Whether there are any echoes; check that all have finite voltages at increasing times, and labels of texts."""
    count = 0
    for echo in echoes:
        finite = np.isfinite(echo.voltage).all() and np.isfinite(echo.time).all()
        if not (finite and (np.diff(echo.time) > 0).all() and echo.time.dtype == echo.voltage.dtype == np.float64):
            raise AssertionError(f"finite voltages at increasing times: {echo}")
        if not all(isinstance(part, str) for pair in echo.label for part in pair):
            raise AssertionError(f"a label of texts: {echo.label}")
        count += 1
    return count > 0


def _read_all(path: Path) -> bool:
    """Read every echo of a file; return whether it could be read."""
    try:
        return check_echoes(recorded_echoes(path, recorded_labels(path)[0]))
    except ValueError as fault:
        return check_refusal(fault, path)


def table(draw: random.Random, folder: Path) -> bool:
    """A CSV file of waveforms, of either form."""
    time = [f"{1e-9 * k:.3g}" for k in range(SAMPLES)]
    if draw.random() < 0.5:
        rows = [["time_s", "mach=0", "mach=3"], *([t, "0.1", "0.2"] for t in time)]
    else:
        head = ["sequence", "label_mach", "sample_period_s", "first_sample_time_s"]
        head += [f"voltage_{k}_v" for k in range(SAMPLES)]
        rows = [head, *([str(k), "3", "1e-9", "0", *["0.1"] * SAMPLES] for k in range(3))]
    for _ in range(draw.choice((0, 1, 1, 2))):
        row = draw.choice((rows[0], rows[1], draw.choice(rows)))
        way, at = draw.randrange(5), draw.randrange(max(len(row), 1))
        if way == 0 and row:
            row[at] = draw.choice(CELLS)
        elif way == 1 and row:
            del row[at]
        elif way == 2:
            row.insert(at, draw.choice(CELLS))
        elif way == 3:
            del row[at:]
        else:
            rows.remove(row)
            rows = rows or [[]]
    text = io.StringIO()
    csv.writer(text, lineterminator=draw.choice(("\n", "\r\n", "\r"))).writerows(rows)
    data = text.getvalue().encode()
    if draw.random() < 0.3:
        data = damaged(data, draw)
    path = folder / "echoes.csv"
    path.write_bytes(data)
    return _read_all(path)


def _sound_store(folder: Path) -> Path:
    path = folder / "sound.sqlite"
    if not path.exists():
        with EchoStore(path) as store:
            store.begin_recording("port", "frames", {"mach": "3"})
            for k in range(4):
                store.add(EchoFrame(k, 1000 * k, 250, 1e-3, 0.0, np.arange(SAMPLES)), 10**18 + k)
            store.commit()
    return path


def _damaged_store(draw: random.Random, folder: Path) -> Path:
    """An echo store with a changed value or damaged bytes."""
    path = folder / "echoes.sqlite"
    for beside in ("-wal", "-shm"):
        path.with_name(path.name + beside).unlink(missing_ok=True)
    shutil.copyfile(_sound_store(folder), path)
    if draw.random() < 0.6:
        with closing(sqlite3.connect(path)) as connection:
            for _ in range(draw.choice((1, 1, 2))):
                try:
                    connection.execute(
                        f"UPDATE echoes SET {draw.choice(COLUMNS)} = ? WHERE id <= ?",
                        (draw.choice(STORED), draw.choice((1, 4))),
                    )
                except (sqlite3.Error, OverflowError):
                    continue
            connection.commit()
    else:
        path.write_bytes(damaged(path.read_bytes(), draw))
    return path


def store_read(draw: random.Random, folder: Path) -> bool:
    """A damaged store, read."""
    return _read_all(_damaged_store(draw, folder))


def store(draw: random.Random, folder: Path) -> bool:
    """A damaged store, read, and exported as NetCDF or CSV."""
    path = _damaged_store(draw, folder)
    read = _read_all(path)
    try:
        with EchoStore(path, read_only=True) as found:
            export(found, folder / draw.choice(("out.csv", "out.nc")))
            found.gaps()
    except (ValueError, StoreError) as fault:
        return read or check_refusal(fault)
    finally:
        if list(folder.glob(".out*")):
            raise AssertionError("a draft is left")
    return read


def netcdf(draw: random.Random, folder: Path) -> bool:
    """A NetCDF file of waveforms with damaged bytes, or with other shapes and types."""
    import h5py

    path = folder / "echoes.nc"
    path.unlink(missing_ok=True)  # a new file, which no other process can have locked
    count = draw.choice((1, 2))
    shapes: dict[str, tuple] = {"voltage": (count, SAMPLES), "time": (SAMPLES,)}
    if draw.random() < 0.5:
        shapes = {"voltage": (count, SAMPLES), "sample_period": (count,), "first_sample_time": (count,)}
    changed = draw.choice((*shapes, "none"))
    with h5py.File(path, "w") as file:
        for name, usual in shapes.items():
            shape = (
                draw.choice((usual[::-1], usual[:-1], (*usual, 2), (0,), (SAMPLES + 1,))) if name == changed else usual
            )
            kind = draw.choice(("f8", "i2", "f4", "S3", "c16", "?")) if name == changed else "f8"
            values = np.zeros(shape, kind)
            if name in ("time", "sample_period") and kind == "f8":
                values = 1e-9 * (1.0 + np.arange(values.size).reshape(shape))
                if draw.random() < 0.2 and values.size:
                    values.flat[-1] = draw.choice((np.nan, np.inf, -1.0, 1e300))
            made = file.create_dataset(name, data=values)
            if draw.random() < 0.3:
                made.attrs["units"] = draw.choice(("ns", "mV", "V", "furlong", "\x1b", 3.0))
        voltage = file["voltage"]
        for axis, name in enumerate(("echo", "sample")[: voltage.ndim]):
            voltage.dims[axis].label = name
        if voltage.ndim and "time" in file and draw.random() < 0.9:
            file["time"].make_scale("time")
    if draw.random() < 0.5:
        path.write_bytes(damaged(path.read_bytes(), draw))
    return _read_all(path)


def sweep(draw: random.Random, folder: Path) -> bool:
    """Damaged records of an interrupted sweep: its definition and its lines."""
    definition = json.dumps({"scene": {"name": "x"}, "vary": {"target.tilt": [0.0, 1.0]}, "version": "0"}).encode()
    lines = b"".join(json.dumps({"case": k, "summary": {"strehl": 0.5}}).encode() + b"\n" for k in range(3))
    odd = (b'{"case": 1e999}\n', b'{"case": "x"}\n', b"[]\n", b'{"case": null}\n', b"\xff\xfe\n", b"[" * 5000 + b"\n",
           b'{"case": 1, "error": 3}\n', b"1" * 5000 + b"\n", b"")  # fmt: skip
    at = draw.randrange(len(lines))
    lines = lines[:at] + draw.choice(odd) + lines[at:]
    if draw.random() < 0.7:
        definition = damaged(definition, draw)
    (folder / DEFINITION_FILE).write_bytes(definition)
    (folder / CASES_FILE).write_bytes(lines)
    records = Records(folder)
    if not all(isinstance(case, int) and isinstance(found, dict) for case, found in records.done.items()):
        raise AssertionError("cases by number")
    with records.writing() as open_records:
        open_records.add(7, {"summary": {}})
    if 7 not in Records(folder).done:
        raise AssertionError("what is added is there")
    try:
        return read_definition(folder) is not None
    except ValueError as fault:
        return check_refusal(fault)


DRAWS: dict[str, Draw] = {"table": table, "store": store, "store-read": store_read, "netcdf": netcdf, "sweep": sweep}
