"""Write the echoes of a store as NetCDF or CSV, in blocks, so that a day of recording need not fit in memory."""

import csv
import itertools
import os
import re
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from aerokernels.files.writing import RetryingFile, draft_of, only_writer
from aerokernels.hardware.rows import StoredEcho, encode_label, signed
from aerokernels.hardware.store import EchoStore, StoreError
from aerokernels.inputs.checks import check_path, listed

ECHOES_AT_ONCE = 1024  # most echoes written at a time


class _Extent(NamedTuple):
    """The number of echoes, the samples of the longest, the samples' times [s] where all agree on them, label keys.

    `is_single` says that single precision resolves the counts of all echoes: not on an offset a million counts high.
    """

    echo_count: int
    sample_count: int
    time: np.ndarray | None
    keys: tuple[str, ...]
    is_single: bool


def export(store: EchoStore, out: str | Path, label: Mapping[str, str] | None = None) -> int:
    """Write the echoes of `store`, as it is at one moment, to `out`, replaced in one step; return their number.

    Args:
        store: open for reading.
        out: FILE.nc (dimensions echo and sample) or FILE.csv (a row for each echo).
        label: select the echoes whose label has these values; their labels may have other keys too.

    Raises:
        TypeError: something other than a store, a path, or texts by their keys.
        ValueError: another file name extension, a folder that does not exist or is not writable, no echoes with this
            label, or a damaged store.
        StoreError: the file could not be written, or the store could not be read.
    """
    if not isinstance(store, EchoStore):
        raise TypeError(f"store must be an EchoStore that is open for reading, got {store!r}")
    if label is not None:
        encode_label(label)  # checks it
    out = check_path(out, "out")
    write = {".nc": _write_netcdf, ".csv": _write_csv}.get(out.suffix.lower())
    if write is None:
        raise ValueError(f"out={out}: give a name that ends in .nc or .csv")
    if not out.parent.is_dir():
        raise ValueError(f"out={out}: folder {out.parent} does not exist; make it first")
    if out.is_dir() or not os.access(out.parent, os.W_OK):
        why = "is a folder" if out.is_dir() else f"no permission to write in {out.parent}"
        raise ValueError(f"out={out}: {why}; give another file name")
    try:
        with only_writer(out), store.snapshot():
            extent = _survey(store, label)
            if not extent.echo_count:
                known = listed(map(_text_of, store.labels()), "none")
                raise ValueError(f"store {store.path}: no echoes with label {_text_of(label or {})}; it has: {known}")
            draft = draft_of(out)
            try:
                write(store, draft, extent, label)
                draft.replace(out)
            finally:
                draft.unlink(missing_ok=True)
    except OSError as error:
        raise StoreError(
            f"out={out}: {os.strerror(error.errno) if error.errno else error}; make room, or give another place"
        ) from error
    return extent.echo_count


def _chosen(store: EchoStore, label: Mapping[str, str] | None) -> Iterator[StoredEcho]:
    wanted = (label or {}).items()
    return (echo for echo in store.echoes() if wanted <= echo.label.items())


def _survey(store: EchoStore, label: Mapping[str, str] | None) -> _Extent:
    count = longest = 0
    axes: set[tuple[float, float]] = set()
    keys: dict[str, None] = {}
    is_single = True
    for echo in _chosen(store, label):
        count += 1
        longest = max(longest, echo.frame.samples.size)
        if len(axes) < 2:
            axes.add((echo.frame.sample_period_ps, echo.frame.first_sample_time))
        keys.update(dict.fromkeys(echo.label))
        if is_single:
            greatest = abs(echo.frame.offset) + 32768.0 * abs(echo.frame.scale)
            # Up to 2^20 counts single precision, and seven digits of a text, resolve a tenth of a count.
            is_single = greatest <= min(2**20 * abs(echo.frame.scale), float(np.finfo(np.float32).max))
    time = None
    if len(axes) == 1:
        ((period, first),) = axes
        time = first + np.arange(longest) * (period * 1e-12)
    return _Extent(count, longest, time, tuple(sorted(keys)), is_single)


def _write_csv(store: EchoStore, draft: Path, extent: _Extent, label: Mapping[str, str] | None) -> None:
    with draft.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(
            [
                "session", "sequence", "device_time_us", "host_time_ns", *(f"label_{key}" for key in extent.keys),
                "sample_period_s", "first_sample_time_s", *(f"voltage_{k}_v" for k in range(extent.sample_count)),
            ]
        )  # fmt: skip
        digits = ".7g" if extent.is_single else ".17g"
        for echo in _chosen(store, label):
            frame = echo.frame
            writer.writerow(
                [
                    echo.session, frame.sequence, "" if frame.device_time_us is None else frame.device_time_us,
                    echo.host_time_ns, *(csv_cell(echo.label.get(key, "")) for key in extent.keys),
                    f"{frame.sample_period_ps * 1e-12:.12g}", f"{frame.first_sample_time:.12g}",
                    *(f"{volt:{digits}}" for volt in frame.voltage.tolist()),
                    *[""] * (extent.sample_count - frame.samples.size),
                ]
            )  # fmt: skip


def _write_netcdf(store: EchoStore, draft: Path, extent: _Extent, label: Mapping[str, str] | None) -> None:
    import h5netcdf
    import h5py

    text, names = h5py.string_dtype(), {key: "label_" + re.sub(r"\W", "_", key) for key in extent.keys}
    real = np.dtype(np.float32 if extent.is_single else np.float64)
    # 2^23 samples are written at a time at most: one long curve makes every row as long.
    at_once = max(1, min(extent.echo_count, ECHOES_AT_ONCE, 2**23 // max(extent.sample_count, 1)))
    # Variables over the echoes: type, unit, meaning and value.
    columns: dict[str, tuple[Any, str, str, Callable[[StoredEcho], Any]]] = {
        "session": ("i4", "1", "run of the board", lambda echo: echo.session),
        "sequence": ("i8", "1", "number of the echo in its run", lambda echo: echo.frame.sequence),
        "device_time_us": ("i8", "us", "the board's clock; -1 where the instrument sends none", _clock),
        "host_time": ("i8", "nanoseconds since 1970-01-01", "host's time of the echo", lambda echo: echo.host_time_ns),
        "flags": ("u1", "1", "the board's flags", lambda echo: echo.frame.flags),
        "sample_count": ("i4", "1", "samples of this echo", lambda echo: echo.frame.samples.size),
        "sample_period": ("f8", "s", "time between two samples", lambda echo: echo.frame.sample_period_ps * 1e-12),
        "first_sample_time": ("f8", "s", "time of the first sample", lambda echo: echo.frame.first_sample_time),
    }
    for key, name in names.items():
        columns[name] = (text, "", f"label {key}", partial(_label_value, key))
    with RetryingFile(draft) as disk, h5netcdf.File(disk, "w") as file:
        file.dimensions = {"echo": extent.echo_count, "sample": extent.sample_count}
        file.attrs["title"] = "recorded echoes"
        file.attrs["source"] = f"aerokernels, store {store.path.name}"
        file.attrs["missing_count"] = sum(gap.missing_count for gap in store.gaps())
        file.attrs["damaged_count"] = store.damaged_count
        for name, (kind, units, meaning, _) in columns.items():
            _describe(file.create_variable(name, ("echo",), kind), units, meaning)
        volts = file.create_variable(
            "voltage", ("echo", "sample"), real, chunks=(at_once, max(extent.sample_count, 1)),
            compression="gzip", compression_opts=1, shuffle=True, fillvalue=real.type("nan"),
        )  # fmt: skip
        _describe(volts, "V", "echo; NaN beyond its own samples")
        coordinates = ["sequence", "host_time", *names.values()]
        if extent.time is not None:
            coordinates.append("time")
            axis = file.create_variable("time", ("sample",), "f8")
            _describe(axis, "s", "time of the sample")
            axis[:] = extent.time
        volts.attrs["coordinates"] = " ".join(coordinates)
        start, echoes = 0, _chosen(store, label)
        while not disk.failure and (block := list(itertools.islice(echoes, at_once))):
            here = slice(start, start + len(block))
            for name, (kind, _, _, value) in columns.items():
                file[name][here] = np.array([value(echo) for echo in block], dtype=kind)
            rows = np.full((len(block), extent.sample_count), np.nan, real)
            for row, echo in zip(rows, block, strict=True):
                row[: echo.frame.samples.size] = echo.frame.voltage
            if extent.sample_count:
                volts[here] = rows
            start += len(block)
    if disk.failure:
        raise disk.failure


def _label_value(key: str, echo: StoredEcho) -> str:
    return echo.label.get(key, "")


def _describe(variable: Any, units: str, meaning: str) -> None:
    if units:
        variable.attrs["units"] = units
    variable.attrs["long_name"] = meaning


def _clock(echo: StoredEcho) -> int:
    clock = echo.frame.device_time_us
    # A clock beyond 2**63 us has run for 292,000 years, or has been set below 0.
    return -1 if clock is None else signed(clock)


def _text_of(label: Mapping[str, str]) -> str:
    return " ".join(f"{key}={value}" for key, value in label.items()) or "(empty)"


def text_of_cell(cell: str) -> str:
    """Return the text for which `csv_cell` wrote a cell."""
    text = cell.removeprefix("'")
    return text if csv_cell(text) == cell else cell


def csv_cell(value: object) -> object:
    """Return a cell's value; a text that begins like a formula and is not a number gets a leading apostrophe."""
    if not isinstance(value, str) or not value.lstrip(" ").startswith(("=", "+", "-", "@", "\t", "\r")):
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value
