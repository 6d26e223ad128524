"""Write the HTML report of a sweep: the keys that vary, figures over these keys, and the numbers of every case."""

import math
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.display.quantities import Quantity
from aerokernels.jobs.figure_layout import Panel, panelled_figure
from aerokernels.jobs.page import Picture, page, pictures, section, table, text_block
from aerokernels.jobs.store import RATIO_KEYS
from aerokernels.jobs.sweeps.definition import CASE, Definition

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_ROWS = 500  # most rows of the table of cases
# Variable, name shown, unit shown, factor from SI.
SHOWN = (
    ("strehl", "Strehl ratio", "", 1.0),
    ("opd_rms_m", "OPD, rms", "nm", 1e9),
    ("boresight_rad", "boresight error", "µrad", 1e6),
    ("echo_peak_v", "echo peak", "V", 1.0),
    ("range_error_m", "range error", "mm", 1e3),
)
# Units in which keys are shown instead of SI, and their factor from SI.
SCALES = {"rad": ("deg", 180.0 / math.pi)}


def sweep_report(dataset: "xarray.Dataset", definition: Definition) -> str:
    """Return the HTML page of a finished sweep."""
    shape = " x ".join(map(str, definition.shape))
    failed = int(dataset.attrs["failed_count"])
    lead = f"{definition.case_count} cases ({shape}) over {', '.join(definition.keys)}"
    lead += f", {failed} failed" if failed else ""
    lead += f"; {dataset.attrs['source']}, {dataset.attrs.get('created', '')}"
    columns, rows = _cases(dataset, definition)
    parts = [
        section("Pictures", pictures(_pictures(dataset, definition)) or "<p>none</p>"),
        section("Cases, each number with its error", table(columns, rows)),
    ]
    if definition.case_count > MOST_ROWS:
        parts.append(f"<p>The first {MOST_ROWS} of {definition.case_count} cases; all of them are in sweep.nc.</p>")
    parts.append(section("Scene of the first case", text_block(str(dataset.attrs["scene"]))))
    return page(str(dataset.attrs["title"]), lead, parts)


def _axis(dataset: "xarray.Dataset", key: str) -> tuple[np.ndarray, str]:
    """Return the values of a key in the unit shown, and the axis label."""
    values, unit = dataset[key].values, str(dataset[key].attrs.get("units", "1"))
    if values.dtype.kind not in "fiu":
        return values.astype(str), key
    name, factor = SCALES.get(unit, (unit, 1.0))
    return values * factor, key if name == "1" else f"{key} [{name}]"


def _pictures(dataset: "xarray.Dataset", definition: Definition) -> Iterator[Picture]:
    """Yield figures: lines over one key, heat maps over two; any further key is fixed at its first value."""
    for name, words, unit, factor in SHOWN:
        values = dataset[name] * factor
        if not np.isfinite(values).any():
            continue
        label = f"{words} [{unit}]" if unit else words
        if definition.mode != "grid":
            for key in definition.keys:
                caption = f"{label} over {key}, case by case"
                yield f"{name}-{key}", caption, partial(_scatter_figure, dataset, values, key, label)
            continue
        dims = sorted(definition.dims, key=lambda dim: -dataset.sizes[dim])[:2]
        dims = [dim for dim in definition.dims if dim in dims]  # in the order given
        rest = {dim: 0 for dim in definition.dims if dim not in dims}
        described = ", ".join(f"{dim} = {_axis(dataset, dim)[0][0]}" for dim in rest)
        caption = f"{label} over {' and '.join(dims)}" + (f", at {described}" if described else "")
        drawn = values.isel(rest).transpose(*dims)
        if len(dims) == 1 or 1 in drawn.shape:
            longest = max(dims, key=lambda dim: dataset.sizes[dim])
            error = dataset[f"{name}_error"].isel(rest).values.ravel() * factor
            yield name, caption, partial(_line_figure, dataset, drawn.values.ravel(), error, longest, label)
        else:
            yield name, caption, partial(_heat_map, dataset, drawn, label)


def _places(values: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the positions at which values of a key are drawn, and the tick labels if the values are not floats."""
    return (values.astype(float), None) if values.dtype.kind == "f" else (np.arange(len(values), dtype=float), values)


def _line_figure(dataset: "xarray.Dataset", values: np.ndarray, error: np.ndarray, key: str, label: str) -> "Figure":
    axis, words = _axis(dataset, key)
    places, texts = _places(axis)
    figure, axes = _labelled_figure(places, texts, words, label)
    axes.errorbar(places, values, np.where(np.isfinite(error), error, 0.0), marker="o", capsize=3, color="#0b6e99")
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
        if texts is not None:
            set_ticks(places, texts)
    figure.colorbar(mesh, cax=bar, label=label)
    return figure


def _edges(places: np.ndarray) -> np.ndarray:
    """Return the edges of the cells around positions on an axis."""
    if len(places) == 1:
        return places[0] + np.array([-0.5, 0.5])
    middle = 0.5 * (places[1:] + places[:-1])
    return np.concatenate([[2.0 * places[0] - middle[0]], middle, [2.0 * places[-1] - middle[-1]]])


def _cases(dataset: "xarray.Dataset", definition: Definition) -> tuple[list[str], list[list[str]]]:
    """Return the columns and rows of the table of cases."""
    columns = [CASE, *(_axis(dataset, key)[1] for key in definition.keys)]
    columns += [f"{words} [{unit}]" if unit else words for _, words, unit, _ in SHOWN] + ["failures"]
    axes = {key: _axis(dataset, key)[0] for key in definition.keys}
    rows = []
    for number in range(min(definition.case_count, MOST_ROWS)):
        place = np.unravel_index(number, definition.shape)
        row = [str(number)]
        for k, key in enumerate(definition.keys):
            value = axes[key][place[k] if definition.mode == "grid" else place[0]]
            row.append(f"{value:.6g}" if isinstance(value, float) else str(value))
        for name, _, _, factor in SHOWN:
            value = float(dataset[name].values[place])
            if math.isfinite(value):  # if all cases failed, the dataset has no variables for errors
                error = float(dataset[f"{name}_error"].values[place])
                row.append(Quantity(value, error, is_ratio=name in RATIO_KEYS).scaled(factor, "").text())
            else:
                row.append("none")
        rows.append([*row, str(dataset["failures"].values[place])])
    return columns, rows
