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
from aerokernels.jobs.numbers import NUMBERS, Number
from aerokernels.jobs.page import Panel, Picture, drawn, page, panelled_figure, table
from aerokernels.jobs.sweeps.definition import CASE, Definition

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

MOST_ROWS = 500  # most rows of the table of cases
MOST_LINES = 7  # most lines in a figure; with more values of both keys it is a heat map
SHOWN = ("strehl", "opd_rms_m", "boresight_rad", "echo_peak_v", "range_error_m")
_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")
NO_VALUE = "none"  # in place of a number of a case that failed


def sweep_report(dataset: "xarray.Dataset", definition: Definition) -> str:
    """Return the HTML page of a finished sweep."""
    shape = " x ".join(map(str, definition.shape))
    failed = int(dataset.attrs["failed_count"])
    lead = f"{definition.case_count} cases ({shape}) over {', '.join(definition.keys)}"
    lead += f", {failed} failed" if failed else ""
    lead += f"; {dataset.attrs['source']}, {dataset.attrs.get('created', '')}"
    columns = [_Column.of(dataset, name) for name in SHOWN if np.isfinite(dataset[name].values).any()]
    same = [(each.words, each.texts.flat[0]) for each in columns if each.is_same]
    varying = [each for each in columns if not each.is_same]
    sections: list[dict[str, Any]] = [{"title": "The same in every case", "rows": same}] if same else []
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
    """A quantity over all cases: a column of the table."""

    name: str  # its variable
    number: Number  # what it is, and how it is shown
    texts: np.ndarray  # the number of each case with its error and unit; NO_VALUE where the case failed
    changes: list[bool]  # whether the number changes along each axis, but for rounding; a case that failed is a change

    @classmethod
    def of(cls, dataset: "xarray.Dataset", name: str) -> "_Column":
        """Collect a quantity of a sweep."""
        number, values, texts = NUMBERS[name], dataset[name].values, np.full(dataset[name].shape, NO_VALUE, object)
        # If all cases failed, the dataset has no variables for errors.
        errors = dataset[f"{name}_error"].values if f"{name}_error" in dataset else np.full(values.shape, math.nan)
        for place in zip(*np.isfinite(values).nonzero(), strict=True):
            texts[place] = number.text(Quantity(values[place], float(errors[place]), is_ratio=number.is_ratio))
        size = float(np.fmax.reduce(np.abs(values), axis=None))
        error = float(np.fmax.reduce(errors, axis=None))
        changes = []
        for axis in range(values.ndim):
            first = values.take([0], axis)
            change = float(np.fmax.reduce(np.abs(values - first), axis=None, initial=0.0))
            failures = np.isnan(values) != np.isnan(first)
            changes.append(bool(failures.any()) or not is_flat([size, size + change], number.unit, error))
        return cls(name, number, texts, changes)

    @property
    def words(self) -> str:
        """What it is called."""
        return self.number.name or self.number.words

    @property
    def label(self) -> str:
        """The same with the unit shown."""
        return f"{self.words} [{self.number.shown}]" if self.number.shown else self.words

    @property
    def is_same(self) -> bool:
        """Whether no key changes the number, but for rounding."""
        return self.texts.size > 1 and not any(self.changes)


def _axis(dataset: "xarray.Dataset", key: str) -> tuple[np.ndarray, str]:
    """Return the values of a key, angles in degrees, and the axis label."""
    values, unit = dataset[key].values, str(dataset[key].attrs.get("units", "1"))
    if values.dtype.kind not in "fiu":
        return values.astype(str), key
    if unit == "rad":
        values, unit = np.degrees(values), "deg"
    return values, key if unit == "1" else f"{key} [{unit}]"


def _pictures(dataset: "xarray.Dataset", definition: Definition, shown: list[_Column]) -> Iterator[Picture]:
    """Yield figures over the keys that change a quantity: lines over one or two, heat maps over two with many values.

    Any further key is fixed at its first value.
    """
    for each in shown:
        values = dataset[each.name] * each.number.factor
        error = dataset[f"{each.name}_error"] * each.number.factor
        if definition.mode != "grid":
            for key in definition.keys:
                caption = f"{each.label} over {key}, case by case"
                yield (
                    f"{each.name}-{key}",
                    caption,
                    partial(_line_figure, dataset, values, error, [key], each.label, "o"),
                )
            continue
        counts = [
            dim for dim, changes in zip(definition.dims, each.changes, strict=True) if changes or values.size == 1
        ]
        dims = sorted(counts, key=lambda dim: -dataset.sizes[dim])[:2]
        others = {dim: 0 for dim in definition.dims if dim not in dims}
        caption = f"{each.label} over {' and '.join(dims)}"
        if fixed := [f"{dim} = {_axis(dataset, dim)[0][0]}" for dim in others if dim in counts]:
            caption += f", at {', '.join(fixed)}"
        if without := [dim for dim in others if dim not in counts]:
            caption += f"; {' and '.join(without)} do{'es' if len(without) == 1 else ''} not change it"
        values, error = values.isel(others).transpose(*dims[::-1]), error.isel(others).transpose(*dims[::-1])
        if len(dims) == 1 or dataset.sizes[dims[1]] <= MOST_LINES:
            yield each.name, caption, partial(_line_figure, dataset, values, error, dims, each.label, "o-")
        else:
            yield each.name, caption, partial(_heat_map, dataset, values, dims, each.label)


def _line_figure(
    dataset: "xarray.Dataset",
    values: "xarray.DataArray",
    error: "xarray.DataArray",
    dims: list[str],
    label: str,
    fmt: str,
) -> "Figure":
    """Return a figure with error bars along the first key, a line for each value of the second one."""
    from matplotlib import colormaps

    figure, [(axes, _)] = panelled_figure(Panel(6.4, 3.4))
    places, words = _axis(dataset, dims[0])
    axes.set(xlabel=words, ylabel=label)
    axes.grid(True)
    lines, bars = (each.values.reshape(-1, len(places)) for each in (values, error))
    bars = np.stack([np.nan_to_num(bars, posinf=0.0)] * 2, axis=1)
    if NUMBERS[str(values.name)].is_ratio:  # within 0 and 1
        bars = np.clip(bars, 0.0, np.stack([lines, 1.0 - lines], axis=1).clip(0.0))
    keys, meaning = _axis(dataset, dims[1]) if len(dims) > 1 else (np.array([""]), "")
    colours = ["#0b6e99"] if len(lines) == 1 else colormaps["viridis"](np.linspace(0.0, 0.85, len(lines)))
    for line, bar, key, colour in zip(lines, bars, keys, colours, strict=True):
        words = f"{key:.6g}" if isinstance(key, float) else str(key)
        axes.errorbar(places, line, bar, fmt=fmt, capsize=3, color=colour, label=words)
    if len(lines) > 1:
        axes.legend(title=meaning)
    return figure


def _heat_map(dataset: "xarray.Dataset", values: "xarray.DataArray", dims: list[str], label: str) -> "Figure":
    figure, [(axes, bar)] = panelled_figure(Panel(6.0, 3.8, bar=True))
    places = []
    for dim, axis in zip(dims, (axes.xaxis, axes.yaxis), strict=True):
        keys, words = _axis(dataset, dim)
        places.append(keys if keys.dtype.kind == "f" else np.arange(len(keys)))
        if keys.dtype.kind != "f":
            axis.set_ticks(places[-1], keys)
        axis.set_label_text(words)
    mesh = axes.pcolormesh(*places, np.ma.masked_invalid(values.values), cmap="viridis", shading="nearest")
    axes.set_facecolor("#e3e7eb")  # shows where a case failed
    figure.colorbar(mesh, cax=bar, label=label)
    return figure


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
