"""Read recorded echoes from the recorder's store, a CSV or a NetCDF file by label; docs/compare.md has the layouts."""

import contextlib
import csv
import itertools
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.files.netcdf_reading import errors_naming, open_netcdf
from aerokernels.hardware.export import text_of_cell
from aerokernels.hardware.store import EchoStore
from aerokernels.inputs.checks import check_path, listed
from aerokernels.inputs.units import quantity
from aerokernels.process.foreign_files import FileFault

if TYPE_CHECKING:
    import xarray

LEAST_SAMPLES = 16
UNREADABLE = "cannot be read as a store or as NetCDF-4"

Label = tuple[tuple[str, str], ...]
Row = tuple[int, list[str]]  # a line's number in a CSV file, and its cells


@dataclass(frozen=True, eq=False)
class RecordedEcho:
    """One recorded waveform."""

    label: Label  # the operator's label, sorted by key
    time: np.ndarray  # sample times [s], shape (n,)
    voltage: np.ndarray  # samples [V], shape (n,)


Placed = Iterator[tuple[RecordedEcho, str]]  # echoes with their places in a file


def label_text(label: Label) -> str:
    """Return a label as text: "mach=3"."""
    return " ".join(f"{key}={value}" for key, value in label) or "(no label)"


def recorded_labels(path: str | Path) -> list[Label]:
    """Return the different labels in a file, in the order of their first echo."""
    path = check_path(path, "path")
    if _kind(path) == "store":
        with errors_naming(path, UNREADABLE), EchoStore(path, read_only=True) as store:
            labels = [_as_label(one) for one in store.labels()]
    else:
        labels = [echo.label for echo in recorded_echoes(path)]
    if not labels:
        raise FileFault(f"{path}: holds no echoes; record some with `aerokernels record --store`")
    return list(dict.fromkeys(labels))


def recorded_echoes(
    path: str | Path, label: Label | None = None, unfit: Counter[Label] | None = None
) -> Iterator[RecordedEcho]:
    """Yield the echoes of a file one after the other; with `label`, only those with exactly this label.

    A board may send frames with few or no samples, or without a sample period. In a store, which nobody can edit, such
    echoes are skipped and counted in `unfit`; in a CSV or NetCDF file they are an error.
    """
    path = check_path(path, "path")
    readers: dict[str, Callable[[Path], Placed]] = {
        "store": partial(_from_store, label=label, unfit=Counter() if unfit is None else unfit),
        "netcdf": _from_netcdf,
        "csv": _from_csv,
    }
    for echo, place in readers[_kind(path)](path):
        if label is not None and echo.label != label:
            continue
        if echo.voltage.size < LEAST_SAMPLES or echo.time.shape != echo.voltage.shape:
            raise FileFault(
                f"{place}: {echo.voltage.size} samples; at least {LEAST_SAMPLES} are needed, and a time for each"
            )
        if not (np.isfinite(echo.voltage).all() and np.isfinite(echo.time).all()):
            raise FileFault(f"{place}: some samples are not finite; leave the echo out or repair it")
        if not (np.diff(echo.time) > 0.0).all():
            raise FileFault(f"{place}: the times do not increase; sort them, in seconds")
        yield echo


def random_subset(echoes: Iterable[RecordedEcho], count: int, seed: int = 0) -> list[RecordedEcho]:
    """Choose at most `count` echoes at random with equal probability, in one pass (reservoir sampling)."""
    random = np.random.default_rng(seed)
    source = iter(echoes)
    kept = list(itertools.islice(source, count))
    for number, echo in enumerate(source, start=count + 1):
        place = int(random.integers(number))
        if place < count:
            kept[place] = echo
    return kept


def _kind(path: Path) -> str:
    if not path.is_file():
        what = "is a folder" if path.is_dir() else "no such file"
        raise FileFault(f"{path}: {what}; give the recorder's store, or a CSV or NetCDF file of waveforms")
    with path.open("rb") as file:
        head = file.read(16)
    if head == b"SQLite format 3\x00":
        return "store"
    return "netcdf" if head.startswith((b"\x89HDF", b"CDF")) else "csv"


def _as_label(pairs: Mapping[str, Any]) -> Label:
    return tuple(sorted((str(key).strip(), str(value).strip()) for key, value in pairs.items() if str(value).strip()))


def _from_store(path: Path, label: Label | None, unfit: Counter[Label]) -> Placed:
    with errors_naming(path, UNREADABLE), EchoStore(path, read_only=True) as store:
        for text in store.labels():
            own = _as_label(text)
            for echo in store.echoes(text) if label in (None, own) else ():
                if echo.frame.samples.size < LEAST_SAMPLES or not echo.frame.sample_period_ps > 0:
                    unfit[own] += 1
                    continue
                place = f"{path}: echo of sequence {echo.frame.sequence}"
                yield RecordedEcho(own, echo.frame.time, echo.frame.voltage), place


def _from_netcdf(path: Path) -> Placed:
    with errors_naming(path, UNREADABLE), open_netcdf(path, str(path), decode_times=False, whole=True) as data:
        if "voltage" not in data.variables or data["voltage"].ndim not in (1, 2):
            raise FileFault(f"{path}: holds no `voltage` over (echo, sample); it has: {listed(data.variables)}")
        if not {"time", "sample_period"} & set(data.variables):
            raise FileFault(f"{path}: holds no times: give `time` over sample, or `sample_period` over echo [s]")
        timed, volts = "time" in data.variables, data["voltage"]
        samples = data["time"].dims if timed else ("sample" if "sample" in volts.dims else volts.dims[-1],)
        if not set(samples) <= set(volts.dims):
            raise FileFault(
                f"{path}: `voltage` is over {' and '.join(map(str, volts.dims))}, `time` over "
                f"{' and '.join(map(str, samples))}: give `time` over sample"
            )
        rows = np.atleast_2d(_in_si(path, volts.transpose(..., *samples), "voltage", "V"))

        def column(name: str, values: np.ndarray) -> np.ndarray:
            if values.shape not in ((), (1,), (len(rows),)):
                raise FileFault(f"{path}: `{name}` has shape {values.shape}: give one for each of {len(rows)} echoes")
            return np.broadcast_to(values, (len(rows),))

        keys = [str(name) for name in data.variables if str(name).startswith("label_")]
        labels = {name.removeprefix("label_"): column(name, data[name].values) for name in keys}
        if timed:
            times = np.broadcast_to(_in_si(path, data["time"], "time", "s"), rows.shape)
        else:
            zero = (
                data["sample_period"] * 0.0 if "first_sample_time" not in data.variables else data["first_sample_time"]
            )
            first, period = (
                column(str(one.name), _in_si(path, one, "time", "s")) for one in (zero, data["sample_period"])
            )
            times = first[:, None] + period[:, None] * np.arange(rows.shape[1])
        for k, (time, row) in enumerate(zip(times, rows, strict=True)):
            count = int(np.isfinite(row).sum())
            if np.isfinite(row[:count]).all():  # NaN beyond the echo's own samples is allowed
                time, row = time[:count], row[:count]
            yield (
                RecordedEcho(_as_label({key: values[k] for key, values in labels.items()}), time, row),
                f"{path}: echo {k}",
            )


def _in_si(path: Path, variable: "xarray.DataArray", dimension: str, usual: str) -> np.ndarray:
    """Return a variable's values in SI units by its attribute "units"; without the attribute they are SI."""
    unit = str(variable.attrs.get("units", "")).strip()
    spelled = {"": usual, "1": usual, "second": "s", "seconds": "s", "volt": "V", "volts": "V"}
    try:
        factor = quantity(f"1 {spelled.get(unit.lower(), unit)}", dimension)
    except ValueError as error:
        raise FileFault(f"{path}: the units of `{variable.name}`: {error}") from None
    if variable.dtype.kind not in "iuf":
        raise FileFault(f"{path}: `{variable.name}` holds {variable.dtype}, not real numbers: write the file again")
    return np.asarray(variable.values, dtype=np.float64) * factor


def _from_csv(path: Path) -> Placed:
    """Yield the echoes of a CSV file: of a row each, or of a column each beside one of times."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            cells = csv.reader("\n" if line.startswith("#") else line for line in file)
            rows = ((cells.line_num, row) for row in cells if len(row) > 1 or "".join(row).strip())
            head = [name.strip() for name in next(rows, (1, []))[1]]
            reader = _echo_rows if "voltage_0_v" in head else _echo_columns
            yield from reader(path, head, _of_width(path, len(head), rows))
    except UnicodeDecodeError:
        raise FileFault(f"{path}: neither a store nor NetCDF nor a CSV text; give one of them") from None
    except csv.Error as error:
        raise FileFault(f"{path}: not a CSV file ({error}); give the recorder's store, CSV or NetCDF") from None


def _of_width(path: Path, width: int, rows: Iterable[Row]) -> Iterator[Row]:
    """Yield the rows; raise a ValueError at one of another width, as a file has that was cut off."""
    for number, row in rows:
        if len(row) != width:
            raise FileFault(f"{path}: line {number} has {len(row)} values, the first line {width} columns")
        yield number, row


def _echo_rows(path: Path, head: list[str], rows: Iterable[Row]) -> Placed:
    result = [(int(match[1]), k) for k, name in enumerate(head) if (match := re.fullmatch(r"voltage_(\d+)_v", name))]
    numbers, volts = zip(*sorted(result), strict=True)
    if numbers != tuple(range(len(numbers))):
        wrong = next(at for at, number in enumerate(numbers) if at != number)
        what = f"no column voltage_{wrong}_v" if numbers[wrong] > wrong else f"voltage_{numbers[wrong]}_v twice"
        raise FileFault(f"{path}: has {what}: give one column for each sample, voltage_0_v to voltage_{numbers[-1]}_v")
    if "sample_period_s" not in head:
        raise FileFault(f"{path}: has no column sample_period_s, which sets the times of the samples: add it")
    for number, row in rows:
        place = f"{path}: line {number}"
        values = dict(zip(head, row, strict=True))
        samples = [row[k].strip() for k in volts]
        while samples and not samples[-1]:  # the echo is shorter than the longest one
            samples.pop()
        if "" in samples:
            raise FileFault(
                f"{place}: voltage_{samples.index('')}_v is empty and later samples are not: without it they would "
                "move to earlier times; leave the echo out or fill the gap"
            )
        period = _number(values["sample_period_s"], f"{place}, sample_period_s")
        first = _number(values.get("first_sample_time_s") or "0", f"{place}, first_sample_time_s")
        voltage = np.array([_number(text, place) for text in samples])
        keys = [key for key in values if key.startswith("label_")]
        label = _as_label({key.removeprefix("label_"): text_of_cell(values[key]) for key in keys})
        yield RecordedEcho(label, first + period * np.arange(voltage.size), voltage), place


def _echo_columns(path: Path, head: list[str], rows: Iterable[Row]) -> Placed:
    if len(head) < 2 or not head[0].lower().startswith("time"):
        raise FileFault(
            f"{path}: its first line is {', '.join(head[:3])!r}; give a column `time_s` and one column for each echo, "
            "headed by its label such as mach=3, or a row for each echo with columns voltage_0_v, voltage_1_v ..."
        )
    unit = head[0][len("time") :].strip(" _[]()/")  # of time_s, time_ns, time [us]
    try:
        second = quantity(f"1 {unit}", "time")
    except ValueError:
        raise FileFault(
            f"{path}: its first column is headed {head[0]!r}; give the times in seconds as time_s"
        ) from None
    table = [[_number(text, f"{path}: line {number}") for text in row] for number, row in rows]
    values = np.array(table).reshape(-1, len(head))
    values[:, 0] *= second
    for k, name in enumerate(head[1:], start=1):
        pairs = dict(part.partition("=")[::2] for part in name.split() if "=" in part)
        volts = _voltage_unit(name) * values[:, k]
        yield RecordedEcho(_as_label(pairs), values[:, 0], volts), f"{path}: column {name!r}"


def _voltage_unit(head: str) -> float:
    """Return the unit [V] named in an echo's heading (mach=3 [mV], voltage_mv, mV); 1 V without a unit."""
    for word in head.split():
        if "=" not in word:
            unit = word.rpartition("_")[2].strip("[]()")
            spelled = unit[:-1] + unit[-1:].upper()  # in headings of small letters, such as time_ns, mv is mV
            with contextlib.suppress(ValueError):
                return quantity(f"1 {spelled}", "voltage")
    return 1.0


def _number(text: str, place: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise FileFault(f"{place}: {text!r} is not a number; repair the file") from None
