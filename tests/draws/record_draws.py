"""Random recorded echoes as read from a file, without the file: rows of a store, datasets of waveforms.

As in input_draws.py: an answer with finite numbers at increasing times, or a refusal in one line.
"""

import json
import math
import random
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.hardware.rows import stored_echo
from aerokernels.jobs.recorded import LEAST_SAMPLES, RecordedEcho, checked, waveforms

from .input_draws import Draw
from .refusals import check_refusal

SAMPLES = 20
ODD = (0, 1, -1, 2**31, 2**63 - 1, -(2**63), 1e-300, 1e300, math.inf, -math.inf, math.nan, 0.5, "", "text", "1", b"",
       b"\xff", b"\x01\x00" * 40, "[]", "{}", "null", '{"a": 3}', '{"\\u001b[31m": "x"}', "[" * 3000, "9" * 5000,
       "١", None)  # fmt: skip
UNITS = ("s", "ns", "us", "V", "mV", "furlong", "", "1", "\x1b[2J", 3.0, None, b"s", ["s"], "seconds since 1970-01-01")
KINDS = ("f8", "f4", "i2", "u8", "S3", "U3", "c16", "?", "O", "M8[ns]", "m8[ns]")


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


def row(draw: random.Random, folder: Path) -> bool:
    """A row of a store, in which SQLite may hold any values."""
    scope = draw.random() < 0.5
    columns: list[Any] = [
        7, None if scope else 1000, 250.0 if scope else 250, 0.0, 1e-3, 0.1, draw.randbytes(2 * SAMPLES), 0,
        "YMULT 1" if scope else None, b"",
    ]  # fmt: skip
    text: Any = '{"mach": "3"}'
    for _ in range(draw.choice((0, 1, 1, 2, 3))):
        at = draw.randrange(len(columns) + 1)
        odd = draw.choice(ODD)
        if at < len(columns):
            columns[at] = odd
        else:
            text = odd
    try:
        echo = stored_echo(1, 0, text, *columns)
        label, frame = echo.label, echo.frame
    except (TypeError, ValueError, ArithmeticError, RecursionError) as fault:  # the store reports these in its words
        return bool(str(fault)) and False
    if frame.samples.size < LEAST_SAMPLES or not frame.sample_period_ps > 0:
        return False
    try:
        return check_echoes([checked(RecordedEcho(tuple(label.items()), frame.time, frame.voltage), "row")])
    except ValueError as fault:
        return check_refusal(fault)


def _values(draw: random.Random, name: str, shape: tuple[int, ...], kind: str) -> np.ndarray:
    count = math.prod(shape)
    if kind in ("S3", "U3", "O"):
        texts = [draw.choice(("abc", "1", "", "nan", "é")) for _ in range(count)]
        return np.array(texts, dtype="U3").astype(kind if kind != "S3" else "U3").reshape(shape)
    with np.errstate(all="ignore"):
        values = np.linspace(1.0, 2.0, count).astype(kind).reshape(shape)
    if name in ("time", "sample_period", "first_sample_time") and kind in ("f8", "f4"):
        values = (1e-9 * np.arange(1.0, count + 1.0)).astype(kind).reshape(shape)
    if kind in ("f8", "f4") and count and draw.random() < 0.3:
        values.flat[draw.randrange(count)] = draw.choice((np.nan, np.inf, -np.inf, -1.0, 0.0, 1e300))
    return values


def dataset(draw: random.Random, folder: Path) -> bool:
    """Waveforms with other shapes, types, units and names, as a NetCDF file may hold them."""
    import xarray

    count = draw.choice((0, 1, 2, 3))
    shapes: dict[str, tuple[str, ...]] = {"voltage": ("echo", "sample")}
    if draw.random() < 0.5:
        shapes["time"] = ("sample",)
    else:
        shapes |= {"sample_period": ("echo",), "first_sample_time": ("echo",)}
    if draw.random() < 0.4:
        shapes["label_mach"] = ("echo",)
    changed = draw.choice((*shapes, "none"))
    way = draw.randrange(5)
    if changed != "none" and way == 0:
        shapes[changed] = draw.choice(((), ("echo",), ("sample",), ("sample", "echo"), ("other",),
                                       ("echo", "sample", "other")))  # fmt: skip
    sizes = {"echo": count, "sample": draw.choice((SAMPLES, SAMPLES, 0, 1, 2)), "other": draw.choice((1, 2, SAMPLES))}
    found = {}
    for name, dims in shapes.items():
        kind = draw.choice(KINDS) if name == changed and way == 1 else "U3" if name.startswith("label") else "f8"
        values = _values(draw, name, tuple(sizes[dim] for dim in dims), kind)
        units = draw.choice(UNITS) if name == changed and way == 2 else None
        found[name] = xarray.Variable(dims, values, {} if units is None else {"units": units})
    if changed != "none" and way == 3:
        found[draw.choice(("volts", "label_", "label_a b", "sample_period", "time"))] = found.pop(changed)
    path = Path("echoes.nc")
    try:
        data = xarray.Dataset(found)
    except ValueError:  # a dimension's name on a variable of other dimensions: xarray refuses it, as its reader does
        return False
    try:
        return check_echoes(waveforms(data, path))
    except ValueError as fault:
        if str(path) not in str(fault):
            raise AssertionError(f"the file is not named: {fault}") from fault
        return check_refusal(fault)


def summary(draw: random.Random, folder: Path) -> bool:
    """Random values for a summary, which must become valid JSON."""
    from aerokernels.jobs.store import to_json

    value: Any = draw.choice(ODD)
    for _ in range(draw.randrange(4)):
        value = draw.choice(({"a": value}, [value], (value, 1), {1: value}, np.array([1.0, math.nan]), {value: 1}
                             if isinstance(value, (str, int, float)) else [value]))  # fmt: skip
    if not isinstance(json.loads(json.dumps(to_json({"x": value}), allow_nan=False)), dict):
        raise AssertionError("a summary is an object")
    return True


DRAWS: dict[str, Draw] = {"row": row, "dataset": dataset, "summary": summary}
