"""The report of a sweep: how the answers change over the keys, and the numbers of every case."""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.display.canvas import SHADES
from aerokernels.display.figures import Axis, Line, Lines, Raster
from aerokernels.display.quantities import Quantity
from aerokernels.display.shown import is_flat
from aerokernels.jobs.numbers import NUMBERS, Number
from aerokernels.jobs.pages.page import Answer, Page, Panel
from aerokernels.jobs.sweeps.definition import CASE, Definition

if TYPE_CHECKING:
    import xarray

MOST_ROWS = 500  # most rows of the table of cases
MOST_LINES = len(SHADES)  # most lines in a figure; with more values of both keys it is a heat map
SHOWN = ("strehl", "opd_rms_m", "boresight_rad", "echo_peak_v", "range_error_m")
ANSWERED = ("strehl", "opd_rms_m", "range_error_m")  # the quantities whose range over the cases is said at the top
_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")
NO_VALUE = "none"  # in place of a number of a case that failed
SCALES = {"rad": ("deg", 180.0 / math.pi)}  # units in which keys are shown instead of SI, and their factor from SI


def sweep_page(dataset: "xarray.Dataset", definition: Definition) -> Page:
    """Return the report of a finished sweep, whose dataset is the content of sweep.nc."""
    failed = int(dataset.attrs["failed_count"])
    columns = [column for name in SHOWN if (column := Column.of(dataset, name)).is_there]
    varying = [each for each in columns if not each.is_same]
    same = [(each.words, each.texts.flat[0], "the same in every case", "") for each in columns if each.is_same]
    remarks = [("Failed", f"{failed} of {definition.case_count} cases failed; the reasons are at the end.")]
    return Page(
        "sweep",
        str(dataset.attrs["title"]),
        _asked(dataset, definition),
        _answers(columns),
        list(_panels(dataset, definition, varying)),
        [("The same in every case", same)],
        [(_caption(definition), *_cases(dataset, definition, varying))],
        remarks=remarks if failed else (),
        scene=str(dataset.attrs["scene"]),
        repeat=("aerokernels run scene.toml --out out  # the first case", f"aerokernels sweep {_command(definition)}"),
        details=[("What failed, and why", _reasons(dataset))],
        words=("strehl", "opd", "boresight", "range", "error"),
    )


def _asked(dataset: "xarray.Dataset", definition: Definition) -> list[tuple[str, str]]:
    rows = [
        ("Cases", f"{definition.case_count} ({' × '.join(map(str, definition.shape))})"),
        ("Date", f"{str(dataset.attrs.get('created', ''))[:16].replace('T', ', ')} UTC"),
    ]
    for key in definition.keys:
        values, words = axis_of(dataset, key)
        span = f"{values[0]} to {values[-1]}"
        if values.dtype.kind in "fiu":
            span = f"{np.min(values):.5g} to {np.max(values):.5g}"
        rows.append((words, f"{span}, {np.unique(values).size} values"))
    return [
        *rows,
        ("Machine", str(dataset.attrs.get("machine", ""))),
        ("Run by", str(dataset.attrs.get("executor", ""))),
    ]


def _command(definition: Definition) -> str:
    return "SCENE " + " ".join(f"--vary {key}=..." for key in definition.keys) + " --out out"


def _caption(definition: Definition) -> str:
    caption = "Cases, each number with its error"
    if definition.case_count > MOST_ROWS:
        caption += f"; the first {MOST_ROWS} of {definition.case_count}, all of them are in sweep.nc"
    return caption


def _answers(columns: "list[Column]") -> list[Answer]:
    """Return the least and the greatest of the main quantities over all cases."""
    answers = []
    for each in columns:
        if each.name not in ANSWERED or not np.isfinite(each.values).any():
            continue
        low, high = (each.number.factor * float(end(each.values)) for end in (np.nanmin, np.nanmax))
        value = f"{low:.4g}" if each.is_same else f"{low:.3g} to {high:.3g}"
        error = "" if math.isnan(each.error) else f"Its error is at most {each.number.factor * each.error:.2g}"
        more = f"{error} {each.number.shown}".strip() + "." if error else ""
        answers.append(Answer(each.words, value.replace("-", "−"), "", each.number.shown, "over all cases.", more))
    return answers


@dataclass(frozen=True, eq=False)
class Column:
    """A quantity over all cases: a column of the table.

    Attributes:
        name: Its variable.
        number: What it is, and how it is shown.
        texts: The number of each case with its error and unit; NO_VALUE where the case failed.
        values: The number of each case in SI; NaN where the case failed.
        error: Greatest error of these numbers; NaN if none is known.
    """

    name: str
    number: Number
    texts: np.ndarray
    values: np.ndarray
    error: float

    @classmethod
    def of(cls, dataset: "xarray.Dataset", name: str) -> "Column":
        """Collect a quantity of a sweep."""
        number, values, texts = NUMBERS[name], dataset[name].values, np.full(dataset[name].shape, NO_VALUE, object)
        errors = _errors(dataset, name).values
        for place in zip(*np.isfinite(values).nonzero(), strict=True):
            text = number.text(Quantity(values[place], float(errors[place]), is_ratio=number.is_ratio))
            texts[place] = text.replace("+-", "±")
        return cls(name, number, texts, values, float(np.fmax.reduce(errors, axis=None)))

    @property
    def words(self) -> str:
        """What it is called."""
        return self.number.name or f"{self.number.words[:1].upper()}{self.number.words[1:]}"

    @property
    def label(self) -> str:
        """The same with the unit shown."""
        return f"{self.words} [{self.number.shown}]" if self.number.shown else self.words

    @property
    def is_there(self) -> bool:
        """Whether any case has a number."""
        return bool((self.texts != NO_VALUE).any())

    @property
    def is_same(self) -> bool:
        """Whether no key changes the number, but for rounding."""
        return self.texts.size > 1 and not any(self.changes)

    @property
    def changes(self) -> list[bool]:
        """Whether the number changes along each axis; a case that failed is a change."""
        return [self._changes_along(axis) for axis in range(self.values.ndim)]

    def _changes_along(self, axis: int) -> bool:
        first = self.values.take([0], axis)
        size = float(np.fmax.reduce(np.abs(self.values), axis=None))
        change = float(np.fmax.reduce(np.abs(self.values - first), axis=None, initial=0.0))
        failures = np.isnan(self.values) != np.isnan(first)
        return bool(failures.any()) or not is_flat([size, size + change], self.number.unit, self.error)


def _errors(dataset: "xarray.Dataset", name: str) -> Any:
    """Return a quantity's errors; NaN if all cases failed, for the dataset then has none."""
    return dataset[f"{name}_error"] if f"{name}_error" in dataset else dataset[name] * math.nan


def axis_of(dataset: "xarray.Dataset", key: str) -> tuple[np.ndarray, str]:
    """Return the values of a key in the unit shown, and the axis label."""
    values, unit = dataset[key].values, str(dataset[key].attrs.get("units", "1"))
    if values.dtype.kind not in "fiu":
        return values.astype(str), key
    name, factor = SCALES.get(unit, (unit, 1.0))
    return values * factor, key if name == "1" else f"{key} [{name}]"


def _panels(dataset: "xarray.Dataset", definition: Definition, shown: list[Column]) -> Iterator[Panel]:
    """Yield panels over the keys that change a quantity: lines over one or two, heat maps over two with many values.

    Any further key is fixed at its first value.
    """
    for each in shown:
        values, error = dataset[each.name] * each.number.factor, _errors(dataset, each.name) * each.number.factor
        if definition.mode != "grid":
            for key in definition.keys:
                scattered = _lines(dataset, values, error, [key], each, joined=False)
                says = f"Over {key}, case by case."
                yield Panel(f"{each.name}-{key}", each.words, says, f"{each.words} over {key}.", scattered)
            continue
        counts = [
            dim for dim, changes in zip(definition.dims, each.changes, strict=True) if changes or values.size == 1
        ]
        dims = sorted(counts, key=lambda dim: -dataset.sizes[dim])[:2]
        fixed = {dim: 0 for dim in definition.dims if dim not in dims}
        says = f"Over {' and '.join(dims)}"
        if words := [f"{dim} = {axis_of(dataset, dim)[0][0]}" for dim in fixed if dim in counts]:
            says += f", at {', '.join(words)}"
        if without := [dim for dim in fixed if dim not in counts]:
            says += f"; {' and '.join(without)} do{'es' if len(without) == 1 else ''} not change it"
        part = values.isel(fixed)
        if len(dims) == 1 or dataset.sizes[dims[1]] <= MOST_LINES:
            picture: Lines | Raster = _lines(dataset, part, error.isel(fixed), dims, each, joined=True)
        else:
            picture = _heat_map(dataset, part.transpose(*dims[::-1]), each)
        yield Panel(each.name, each.words, f"{says}.", f"{each.words} over {' and '.join(dims)}.", picture)


def _place(values: np.ndarray, words: str) -> tuple[np.ndarray, Axis]:
    """Return where values of a key are drawn, and the axis."""
    if values.dtype.kind in "fiu":
        unit = re.search(r"\[(.*)\]$", words)
        return values.astype(float), Axis(words, unit=unit[1] if unit else "")
    names = list(dict.fromkeys(map(str, values)))
    return np.array([names.index(str(value)) for value in values], float), Axis(words, names=names)


def _lines(dataset: "xarray.Dataset", values: Any, error: Any, dims: list[str], each: Column, *, joined: bool) -> Lines:
    """Return lines with error bars along the first key, one for each value of the second."""
    place, x = _place(*axis_of(dataset, dims[0]))
    rows, bars = (
        one.transpose(..., dims[0]).values.reshape(-1, len(place)) if joined else one.values[None]
        for one in (values, error)
    )
    bars = np.nan_to_num(bars, posinf=0.0)
    if each.number.is_ratio:  # within 0 and 1
        bars = np.minimum(bars, np.maximum(rows, 1.0 - rows))
    keys, meaning = axis_of(dataset, dims[1]) if len(dims) > 1 else (np.array([""]), "")
    words, _, unit = meaning.partition(" [")
    tail = f" {unit[:-1]}" if unit else ""
    names = [f"{words} = {key:.5g}{tail}" if keys.dtype.kind in "fiu" else str(key) for key in keys]
    steps = np.linspace(0, len(SHADES) - 1, len(rows)).round().astype(int)
    lines = [
        Line(place, row, name, "one" if len(rows) == 1 else f"c{step}", bar, dots=True, joined=joined)
        for row, bar, name, step in zip(rows, bars, names, steps, strict=True)
    ]
    return Lines(x, Axis(each.label, unit=each.number.shown), lines, pick=len(lines) > 1)


def _heat_map(dataset: "xarray.Dataset", values: Any, each: Column) -> Raster:
    """Return a heat map over two keys; cells stand at equal distances, and one of a failed case is grey."""
    axes = []
    for dim in reversed(values.dims):
        keys, words = axis_of(dataset, str(dim))
        names = [f"{key:.4g}" if keys.dtype.kind in "fiu" else str(key) for key in keys]
        axes.append(Axis(words, names=names))
    scale = Axis(each.label, unit=each.number.shown)
    return Raster(axes[0], axes[1], values.values[None], scale, even=False)


def _cases(dataset: "xarray.Dataset", definition: Definition, shown: list[Column]) -> tuple[list[str], list[list[str]]]:
    """Return the columns and rows of the table of cases."""
    columns = [CASE, *(axis_of(dataset, key)[1] for key in definition.keys), *(each.words for each in shown)]
    axes = {key: axis_of(dataset, key)[0] for key in definition.keys}
    rows = []
    for number in range(min(definition.case_count, MOST_ROWS)):
        place = np.unravel_index(number, definition.shape)
        row = [str(number)]
        for k, key in enumerate(definition.keys):
            value = axes[key][place[k] if definition.mode == "grid" else place[0]]
            row.append(f"{value:.6g}" if isinstance(value, float) else str(value))
        rows.append([*row, *(str(each.texts[place]) for each in shown)])
    return columns, rows


def _reasons(dataset: "xarray.Dataset") -> list[str]:
    """Return why cases, or stages of them, failed: once for reasons that differ in their numbers only."""
    alike: dict[str, list[tuple[int, str]]] = {}
    for number, reason in enumerate(map(str, dataset["failures"].values.ravel())):
        if reason:
            alike.setdefault(_NUMBER.sub("", reason), []).append((number, reason))
    lines = []
    for cases in alike.values():
        number, reason = cases[0]
        more = f" and {len(cases) - 1} more" if len(cases) > 1 else ""
        lines.append(f"Case {number}{more}: {reason}")
    return lines
