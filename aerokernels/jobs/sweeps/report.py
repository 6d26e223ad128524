"""Write the HTML report of a sweep: the keys that vary, figures over these keys, and the numbers of every case."""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.display.quantities import Quantity
from aerokernels.display.shown import is_flat
from aerokernels.jobs.figure_layout import Panel, panelled_figure
from aerokernels.jobs.numbers import NUMBERS, Number
from aerokernels.jobs.page import Picture, drawn, named_values, page, table
from aerokernels.jobs.sweeps.definition import CASE, Definition

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_ROWS = 500  # most rows of the table of cases
MOST_LINES = 7  # most lines in a figure; with more values of both keys it is a heat map
MOST_TICKS = 12  # most values of a key that are ticks of a heat map
SHOWN = ("strehl", "opd_rms_m", "boresight_rad", "echo_peak_v", "range_error_m")
_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")
NO_VALUE = "none"  # in place of a number of a case that failed
# Units in which keys are shown instead of SI, and their factor from SI.
SCALES = {"rad": ("deg", 180.0 / math.pi)}


def sweep_report(dataset: "xarray.Dataset", definition: Definition) -> str:
    """Return the HTML page of a finished sweep."""
    shape = " x ".join(map(str, definition.shape))
    failed = int(dataset.attrs["failed_count"])
    lead = f"{definition.case_count} cases ({shape}) over {', '.join(definition.keys)}"
    lead += f", {failed} failed" if failed else ""
    lead += f"; {dataset.attrs['source']}, {dataset.attrs.get('created', '')}"
    columns = [column for name in SHOWN if (column := _Column.of(dataset, name)).is_there]
    same = [(each.words, each.texts.flat[0]) for each in columns if each.is_same]
    varying = [each for each in columns if not each.is_same]
    sections = [named_values("The same in every case", same)] if same else []
    pictures = drawn(_pictures(dataset, definition, varying))
    sections.append({"title": "Pictures", "figures": pictures, "paragraphs": [] if pictures else ["none"]})
    sections.append(table("Cases, each number with its error", *_cases(dataset, definition, varying)))
    if definition.case_count > MOST_ROWS:
        first = f"The first {MOST_ROWS} of {definition.case_count} cases; all of them are in sweep.nc."
        sections[-1]["paragraphs"] = [first]
    if reasons := _reasons(dataset):
        sections.append({"title": "What failed, and why", "bullets": reasons})
    sections.append({"title": "Scene of the first case", "text": str(dataset.attrs["scene"])})
    return page(str(dataset.attrs["title"]), lead, sections)


@dataclass(frozen=True, eq=False)
class _Column:
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
    def of(cls, dataset: "xarray.Dataset", name: str) -> "_Column":
        """Collect a quantity of a sweep."""
        number, values, texts = NUMBERS[name], dataset[name].values, np.full(dataset[name].shape, NO_VALUE, object)
        # If all cases failed, the dataset has no variables for errors.
        errors = dataset[f"{name}_error"].values if f"{name}_error" in dataset else np.full(values.shape, math.nan)
        for place in zip(*np.isfinite(values).nonzero(), strict=True):
            texts[place] = number.text(Quantity(values[place], float(errors[place]), is_ratio=number.is_ratio))
        return cls(name, number, texts, values, float(np.fmax.reduce(errors, axis=None)))

    @property
    def words(self) -> str:
        """What it is called."""
        return self.number.name or self.number.words

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


def _axis(dataset: "xarray.Dataset", key: str) -> tuple[np.ndarray, str]:
    """Return the values of a key in the unit shown, and the axis label."""
    values, unit = dataset[key].values, str(dataset[key].attrs.get("units", "1"))
    if values.dtype.kind not in "fiu":
        return values.astype(str), key
    name, factor = SCALES.get(unit, (unit, 1.0))
    return values * factor, key if name == "1" else f"{key} [{name}]"


def _pictures(dataset: "xarray.Dataset", definition: Definition, shown: list[_Column]) -> Iterator[Picture]:
    """Yield figures over the keys that change a quantity: lines over one or two, heat maps over two with many values.

    Any further key is fixed at its first value.
    """
    for each in shown:
        values = dataset[each.name] * each.number.factor
        if definition.mode != "grid":
            for key in definition.keys:
                caption = f"{each.label} over {key}, case by case"
                yield f"{each.name}-{key}", caption, partial(_scatter_figure, dataset, values, key, each.label)
            continue
        counts = [
            dim for dim, changes in zip(definition.dims, each.changes, strict=True) if changes or values.size == 1
        ]
        dims = sorted(counts, key=lambda dim: -dataset.sizes[dim])[:2]
        rest = {dim: 0 for dim in definition.dims if dim not in dims}
        caption = f"{each.label} over {' and '.join(dims)}"
        if fixed := [f"{dim} = {_axis(dataset, dim)[0][0]}" for dim in rest if dim in counts]:
            caption += f", at {', '.join(fixed)}"
        if without := [dim for dim in rest if dim not in counts]:
            caption += f"; {' and '.join(without)} do{'es' if len(without) == 1 else ''} not change it"
        drawn = values.isel(rest)
        if len(dims) == 1 or dataset.sizes[dims[1]] <= MOST_LINES:
            error = dataset[f"{each.name}_error"].isel(rest) * each.number.factor
            yield each.name, caption, partial(_line_figure, dataset, drawn, error, dims, each.label)
        else:
            yield each.name, caption, partial(_heat_map, dataset, drawn.transpose(*dims[::-1]), each.label)


def _places(values: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the positions at which values of a key are drawn, and the tick labels if the values are not floats."""
    return (values.astype(float), None) if values.dtype.kind == "f" else (np.arange(len(values), dtype=float), values)


def _line_figure(
    dataset: "xarray.Dataset", values: "xarray.DataArray", error: "xarray.DataArray", dims: list[str], label: str
) -> "Figure":
    """Return a figure of lines with error bars along the first key, one for each value of the second one."""
    from matplotlib import colormaps

    axis, words = _axis(dataset, dims[0])
    places, texts = _places(axis)
    figure, axes = _labelled_figure(places, texts, words, label)
    lines, bars = (each.transpose(..., dims[0]).values.reshape(-1, len(places)) for each in (values, error))
    bars = np.stack([np.nan_to_num(bars, posinf=0.0)] * 2, axis=1)
    if NUMBERS[str(values.name)].is_ratio:  # within 0 and 1
        bars = np.clip(bars, 0.0, np.stack([lines, 1.0 - lines], axis=1).clip(0.0))
    keys, meaning = _axis(dataset, dims[1]) if len(dims) > 1 else (np.array([""]), "")
    colours = ["#0b6e99"] if len(lines) == 1 else colormaps["viridis"](np.linspace(0.0, 0.85, len(lines)))
    for line, bar, key, colour in zip(lines, bars, keys, colours, strict=True):
        axes.errorbar(
            places,
            line,
            bar,
            marker="o",
            capsize=3,
            color=colour,
            label=f"{key:.6g}" if isinstance(key, float) else str(key),
        )
    if len(lines) > 1:
        axes.legend(title=meaning)
    return figure


def _scatter_figure(dataset: "xarray.Dataset", values: Any, key: str, label: str) -> "Figure":
    axis, words = _axis(dataset, key)
    places, texts = _places(axis)
    ticks = places
    if texts is not None:
        texts, places = np.unique(texts, return_inverse=True)
        ticks = np.arange(len(texts))
    figure, axes = _labelled_figure(ticks, texts, words, label)
    axes.plot(places, values.values, "o", color="#0b6e99")
    return figure


def _labelled_figure(ticks: np.ndarray, texts: np.ndarray | None, words: str, label: str) -> "tuple[Figure, Axes]":
    figure, [(axes, _)] = panelled_figure(Panel(6.4, 3.4))
    axes.set(xlabel=words, ylabel=label)
    axes.grid(True)
    if texts is not None:
        axes.set_xticks(ticks, texts)
    return figure, axes


def _heat_map(dataset: "xarray.Dataset", values: "xarray.DataArray", label: str) -> "Figure":
    rows, columns = (_axis(dataset, str(dim)) for dim in values.dims)
    figure, [(axes, bar)] = panelled_figure(Panel(6.0, 3.8, bar=True))
    edges = [_edges(_places(axis)[0]) for axis, _ in (columns, rows)]
    mesh = axes.pcolormesh(*edges, np.ma.masked_invalid(values.values), cmap="viridis", shading="flat")
    axes.set_facecolor("#e3e7eb")  # shows where a case failed
    axes.set(xlabel=columns[1], ylabel=rows[1])
    for axis, set_ticks in ((columns[0], axes.set_xticks), (rows[0], axes.set_yticks)):
        places, texts = _places(axis)
        if texts is not None or len(places) <= MOST_TICKS:  # cells are wider than the values that they stand for
            set_ticks(places, [f"{value:.6g}" for value in places] if texts is None else texts)
    figure.colorbar(mesh, cax=bar, label=label)
    return figure


def _edges(places: np.ndarray) -> np.ndarray:
    """Return the edges of the cells around positions on an axis."""
    if len(places) == 1:
        return places[0] + np.array([-0.5, 0.5])
    middle = 0.5 * (places[1:] + places[:-1])
    return np.concatenate([[2.0 * places[0] - middle[0]], middle, [2.0 * places[-1] - middle[-1]]])


def _cases(
    dataset: "xarray.Dataset", definition: Definition, shown: list[_Column]
) -> tuple[list[str], list[list[str]]]:
    """Return the columns and rows of the table of cases."""
    columns = [CASE, *(_axis(dataset, key)[1] for key in definition.keys), *(each.words for each in shown)]
    axes = {key: _axis(dataset, key)[0] for key in definition.keys}
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
    found = []
    for cases in alike.values():
        number, reason = cases[0]
        more = f" and {len(cases) - 1} more" if len(cases) > 1 else ""
        found.append(f"Case {number}{more}: {reason}")
    return found
