"""Read recorded echoes from a CSV file, in one of two forms.

One row per echo: columns `voltage_0_v`, `voltage_1_v` ... in any order, `sample_period_s`, `first_sample_time_s` (0 if
absent) and `label_KEY` for each key of a label; a shorter echo ends in empty cells. Or one column per echo: the first
column is the time, in seconds unless its heading names a unit (time_ns), and the heading of each other column is its
label, with a unit unless its numbers are volts:

    time_s, mach=0, mach=2, mach=2 [mV]
    0.0, 0.01, 0.02, 10
"""

import contextlib
import csv
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from aerokernels.hardware.export import text_of_cell
from aerokernels.inputs.units import quantity
from aerokernels.process.foreign_files import FileFault

CsvEcho = tuple[dict[str, str], np.ndarray, np.ndarray, str]
Row = tuple[int, list[str]]  # a line's number in the file, and its cells


def csv_echoes(path: Path) -> Iterator[CsvEcho]:
    """Yield the echoes of a CSV file: label, times [s], voltages [V], and the place in the file for messages.

    Raises:
        ValueError: the file is neither of the two forms; the message names the place and the remedy.
    """
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


def _echo_rows(path: Path, head: list[str], rows: Iterable[Row]) -> Iterator[CsvEcho]:
    found = [(int(match[1]), k) for k, name in enumerate(head) if (match := re.fullmatch(r"voltage_(\d+)_v", name))]
    numbers, volts = zip(*sorted(found), strict=True)
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
        time = first + period * np.arange(voltage.size)
        label = {
            key.removeprefix("label_"): text_of_cell(text) for key, text in values.items() if key.startswith("label_")
        }
        yield label, time, voltage, place


def _echo_columns(path: Path, head: list[str], rows: Iterable[Row]) -> Iterator[CsvEcho]:
    if len(head) < 2 or not head[0].lower().startswith("time"):
        raise FileFault(
            f"{path}: its first line is {', '.join(head[:3])!r}; give a column `time_s` and one column for each echo, "
            "headed by its label such as mach=3, or a row for each echo with columns voltage_0_v, voltage_1_v ..."
        )
    second = _time_unit(path, head[0])
    table = [[_number(text, f"{path}: line {number}") for text in row] for number, row in rows]
    values = np.array(table).reshape(-1, len(head))
    values[:, 0] *= second
    for k, name in enumerate(head[1:], start=1):
        pairs = dict(part.partition("=")[::2] for part in name.split() if "=" in part)
        volts = _voltage_unit(name) * values[:, k]
        yield pairs, values[:, 0], volts, f"{path}: column {name!r}"


def _voltage_unit(head: str) -> float:
    """Return the unit [V] named in an echo's heading (mach=3 [mV], voltage_mv, mV); 1 V without a unit."""
    for word in head.split():
        if "=" not in word:
            unit = word.rpartition("_")[2].strip("[]()")
            spelled = unit[:-1] + unit[-1:].upper()  # in headings of small letters, such as time_ns, mv is mV
            with contextlib.suppress(ValueError):
                return quantity(f"1 {spelled}", "voltage")
    return 1.0


def _time_unit(path: Path, head: str) -> float:
    """Return the unit [s] named in a time column's heading (time_s, time_ns, time [us]); 1 s without a unit."""
    unit = head[len("time") :].strip(" _[]()/")
    try:
        return quantity(f"1 {unit}", "time")
    except ValueError:
        raise FileFault(f"{path}: its first column is headed {head!r}; give the times in seconds as time_s") from None


def _number(text: str, place: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise FileFault(f"{place}: {text!r} is not a number; repair the file") from None
