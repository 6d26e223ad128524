"""Write the echoes of a store as NetCDF or CSV, in blocks, so that a day of recording need not fit in memory."""

import csv
import itertools
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.files.writing import RetryingFile, draft_of, only_writer
from aerokernels.hardware.rows import StoredEcho, encode_label, signed
from aerokernels.hardware.store import EchoStore, StoreError
from aerokernels.inputs.checks import check_path, listed

ECHOES_AT_ONCE = 1024  # most echoes written at a time
# Counts from 0 V up to which single precision, and seven digits of a text, resolve a tenth of a count.
SINGLE_COUNTS = 2**20


@dataclass(frozen=True)
class _Extent:
    """The size and common properties of the echoes to be written.

    Attributes:
        count: number of echoes.
        sample_count: samples of the longest echo.
        time: time of each sample [s], where all echoes agree on it; None otherwise.
        keys: keys of their labels.
        is_single: whether single precision resolves the counts of all echoes: not on an offset a million counts high.
    """

    count: int
    sample_count: int
    time: np.ndarray | None
    keys: tuple[str, ...]
    is_single: bool

    @property
    def at_once(self) -> int:
        """Echoes written at a time."""
        # 2^23 samples are written at a time at most: one long curve makes every row as long.
        return max(1, min(self.count, ECHOES_AT_ONCE, 2**23 // max(self.sample_count, 1)))


def export(store: EchoStore, out: str | Path, label: Mapping[str, str] | None = None) -> int:
    """Write the echoes of `store` to `out`; return their number.

    A recorder may go on writing to the store meanwhile: the export shows the store at one moment. `out` is replaced in
    one step when the export is complete.

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
            if not extent.count:
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
    return extent.count


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
            is_single = greatest <= min(SINGLE_COUNTS * abs(echo.frame.scale), float(np.finfo(np.float32).max))
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

    text = h5py.string_dtype()
    label_names = _label_names(extent.keys)
    with RetryingFile(draft) as disk, h5netcdf.File(disk, "w") as file:
        file.dimensions = {"echo": extent.count, "sample": extent.sample_count}
        file.attrs["title"] = "recorded echoes"
        file.attrs["source"] = f"aerokernels, store {store.path.name}"
        file.attrs["missing_count"] = sum(gap.missing_count for gap in store.gaps())
        file.attrs["damaged_count"] = store.damaged_count
        columns = [
            (_variable(file, name, ("echo",), kind, units, meaning), kind, value)
            for name, kind, units, meaning, value in (
                ("session", "i4", "1", "run of the board", lambda echo: echo.session),
                ("sequence", "i8", "1", "number of the echo in its run", lambda echo: echo.frame.sequence),
                ("device_time_us", "i8", "us", "the board's clock; -1 where the instrument sends none", _clock),
                (
                    "host_time",
                    "i8",
                    "nanoseconds since 1970-01-01",
                    "when the echo was complete on the host",
                    lambda echo: echo.host_time_ns,
                ),
                ("flags", "u1", "1", "the board's flags", lambda echo: echo.frame.flags),
                ("sample_count", "i4", "1", "samples of this echo", lambda echo: echo.frame.samples.size),
                (
                    "sample_period",
                    "f8",
                    "s",
                    "time between two samples",
                    lambda echo: echo.frame.sample_period_ps * 1e-12,
                ),
                ("first_sample_time", "f8", "s", "time of the first sample", lambda echo: echo.frame.first_sample_time),
                *(
                    (name, text, "", f"label {key}", lambda echo, key=key: echo.label.get(key, ""))
                    for key, name in label_names.items()
                ),
            )
        ]
        real = np.dtype(np.float32 if extent.is_single else np.float64)
        volts = _variable(
            file, "voltage", ("echo", "sample"), real, "V", "echo; NaN beyond its own samples",
            chunks=(extent.at_once, max(extent.sample_count, 1)), compression="gzip",
            compression_opts=1, shuffle=True, fillvalue=real.type("nan"),
        )  # fmt: skip
        coordinates = ["sequence", "host_time", *label_names.values()]
        if extent.time is not None:
            coordinates.append("time")
            _variable(file, "time", ("sample",), "f8", "s", "time of the sample")[:] = extent.time
        volts.attrs["coordinates"] = " ".join(coordinates)
        start = 0
        for block in _blocks(_chosen(store, label), extent.at_once):
            here = slice(start, start + len(block))
            for column, kind, value in columns:
                column[here] = np.array([value(echo) for echo in block], dtype=kind)
            rows = np.full((len(block), extent.sample_count), np.nan, real)
            for row, echo in zip(rows, block, strict=True):
                row[: echo.frame.samples.size] = echo.frame.voltage
            if extent.sample_count:
                volts[here] = rows
            start += len(block)
            if disk.failure:
                break
    if disk.failure:
        raise disk.failure


def _variable(file: Any, name: str, dims: tuple[str, ...], kind: Any, units: str, meaning: str, **options: Any) -> Any:
    variable = file.create_variable(name, dims, kind, **options)
    if units:
        variable.attrs["units"] = units
    variable.attrs["long_name"] = meaning
    return variable


def _clock(echo: StoredEcho) -> int:
    clock = echo.frame.device_time_us
    # A clock beyond 2**63 us has run for 292,000 years, or has been set below 0.
    return -1 if clock is None else signed(clock)


def _label_names(keys: tuple[str, ...]) -> dict[str, str]:
    """Return a NetCDF name for each key of a label; a name that is already used gets underscores appended."""
    names: dict[str, str] = {}
    for key in keys:
        name = "label_" + re.sub(r"\W", "_", key)
        while name in names.values():
            name += "_"
        names[key] = name
    return names


def _blocks(echoes: Iterator[StoredEcho], count: int) -> Iterator[list[StoredEcho]]:
    while block := list(itertools.islice(echoes, count)):
        yield block


def _text_of(label: Mapping[str, str]) -> str:
    return " ".join(f"{key}={value}" for key, value in label.items()) or "(empty)"


FORMULA = ("=", "+", "-", "@", "\t", "\r")


def text_of_cell(cell: str) -> str:
    """Return the text for which `csv_cell` wrote a cell."""
    text = cell.removeprefix("'")
    return text if csv_cell(text) == cell else cell


def csv_cell(value: object) -> object:
    """Return a cell's value; a text that begins like a formula and is not a number gets a leading apostrophe."""
    if not isinstance(value, str) or not value.lstrip(" ").startswith(FORMULA):
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value
