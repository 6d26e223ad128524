"""Run a series job: OPD maps of flow snapshots, their statistics, and a report."""

import io
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels import __version__
from aerokernels.display.quantities import Quantity
from aerokernels.display.shown import is_flat, say_flat, told
from aerokernels.files.writing import only_writer, replacing
from aerokernels.flow import Series, open_series
from aerokernels.jobs.numbers import SERIES_NUMBERS, quantity_of
from aerokernels.jobs.page import Panel, Picture, drawn, embedded, page, panelled_figure, plain_decades, table
from aerokernels.jobs.plots import axes_of
from aerokernels.jobs.run_files import scene_toml
from aerokernels.jobs.store import (
    MAPS_FILE,
    REPORT_FILE,
    SUMMARY_FILE,
    check_output_folder,
    replace_result,
    to_json,
    write_summary,
    write_text,
)
from aerokernels.pupils import direction_of
from aerokernels.scene import Scene, warn_of_unused
from aerokernels.scene.pupil_table import axis_words
from aerokernels.scene.tables import FileTable
from aerokernels.series import optical_series, statistics
from aerokernels.tracing.pupil.air import GREATEST_SHARE

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

Progress = Callable[[str, float], None]
STATISTICS_FILE = "statistics.nc"
STANDARD_ERRORS = 2.0  # of which an error consists: it covers the truth in at least 95 of 100 cases
MOST_FRAMES, FRAME_SIDE = 60, 320  # most frames of the film, and least pixels along a side


def scene_series(scene: Scene) -> Series:
    """Open the snapshots of a scene."""
    table = scene.series
    if table.source is None:
        raise ValueError(
            'series.source is missing: add a table [series] with source = "flow.nc", a file with a time axis, or a '
            "pattern of numbered files"
        )
    # Options for files that `flow.read` reads; each of them has a single time.
    usual = FileTable().read_options()
    asked = scene.flow.file.read_options()
    options = {name: value for name, value in asked.items() if name != "time" and value != usual.get(name)}
    given = {"ambient_density": table.ambient_density, "density": table.density, "species": scene.flow.species}
    options |= {name: value for name, value in given.items() if value is not None}
    try:
        return open_series(table.source, time_step=table.time_step, **options)
    except (TypeError, ValueError) as fault:
        raise ValueError(f"series.source: {fault}") from fault


def scene_look(scene: Scene) -> np.ndarray:
    """Return the direction of view of a series: that of [series], or of the pupil if it gives none; shape (3,)."""
    own, pupil = scene.series, scene.pupil
    azimuth = pupil.azimuth if own.azimuth is None else own.azimuth
    return direction_of(azimuth, pupil.elevation if own.elevation is None else own.elevation)


def run_series(scene: Scene, out: Path, progress: Progress | None = None) -> dict[str, Any]:
    """Run the whole job and return its summary; maps from an interrupted job in the same folder are reused."""
    check_output_folder(out, own=(MAPS_FILE,))
    with only_writer(out):
        series, table, trace = scene_series(scene), scene.series, scene.trace
        warn_of_unused(scene, "series")
        report = progress or (lambda text, share: None)
        maps = optical_series(
            series,
            scene.view,
            direction=scene_look(scene),
            remove=table.remove,
            wavelength=scene.flow.wavelength,
            relation=scene.flow.relation,
            constant=scene.flow.gladstone_dale,
            pixel_count=table.pixel_count,
            tolerance=trace.tolerance,
            backend=trace.backend,
            device=trace.device,
            precision=trace.precision,
            out=out / MAPS_FILE,
            progress=lambda text, share: report(text, 0.9 * share),
        )
        report("statistics", 0.9)
        found = statistics(maps, velocity=table.velocity, length=table.length)
        found.attrs["pupil_axes"] = list(axis_words(scene.view))
        summary = summarise(scene, maps, found)
        report("writing the report", 0.95)
        replace_result(out / STATISTICS_FILE, found)
        with replacing(out / SUMMARY_FILE, name="out=") as (draft,):
            write_summary(draft, summary)
        write_text(out / REPORT_FILE, series_report(scene, maps, found, summary))
        return summary


def summarise(scene: Scene, maps: "xarray.Dataset", found: "xarray.Dataset") -> dict[str, Any]:
    """Return the scalar statistics with their errors and the provenance; NaN becomes None."""
    names = [str(name) for name in found.data_vars if found[name].ndim == 0 and not str(name).endswith("_error")]
    errors = np.asarray(maps["error"].values)
    return to_json(
        {
            "scene": scene.name,
            "title": scene.title,
            **{name: float(found[name]) for name in names},
            "errors": {name: STANDARD_ERRORS * float(found[f"{name}_error"]) for name in names},
            "independent_count": found.attrs["independent_count"],
            "skipped": found.attrs["skipped"],
            "snapshot_count": int(maps.sizes["time"]),
            "traced_count": int(np.asarray(maps["traced"].values).sum()),
            "warnings": [text for text in (str(maps.attrs.get("truncation", "")), found.attrs["warnings"]) if text],
            "ends": str(maps.attrs.get("ends", "")),
            "known_share": float(np.asarray(maps["known"].values).min()),
            "opd_error_m": float(np.nanmax(errors)) if np.isfinite(errors).any() else None,
            "wavelength_m": float(maps.attrs["wavelength"]),
            "plan": maps.attrs["plan"],
            "provenance": maps.attrs["provenance"],
            "version": __version__,
        }
    )


def headline_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the main statistics of a series' summary as rows of name and text with error and unit."""
    shown = {key: one for key, one in SERIES_NUMBERS.items() if summary.get(key) is not None}
    return [(one.name, one.text(quantity_of(summary, key))) for key, one in shown.items()]


def series_report(scene: Scene, maps: "xarray.Dataset", found: "xarray.Dataset", summary: Mapping[str, Any]) -> str:
    """Return the HTML page of a finished series."""
    lead = (
        f"{summary['snapshot_count']} snapshots, as many as {summary['independent_count']:.3g} independent ones, "
        f"{summary['traced_count']} traced in full; {summary['provenance']}; aerokernels {summary['version']}"
    )
    notes = [("Warning", text) for text in summary["warnings"]]
    notes += [("Skipped", summary["skipped"])] if summary["skipped"] else []
    if summary["known_share"] < 1.0 - GREATEST_SHARE:
        lost = f"{100.0 * (1.0 - summary['known_share']):.3g} % of the pupil has no optical path; no number includes it"
        notes.append(("Known air", lost))
    units = {name: str(found[name].attrs["units"]).removeprefix("1") for name in summary["errors"]}
    numbers = [(name, told(quantity_of(summary, name), 1.0, unit)) for name, unit in units.items()]
    sections = [
        {"title": "Film of the optical path difference", **film(maps)},
        {"title": "Pictures", "figures": drawn(_pictures(maps, found))},
        table("Numbers (SI), each with its error", ("quantity", "value"), numbers),
        {"title": "How the maps were computed", "paragraphs": [str(summary["plan"])]},
        {"title": "Scene as it was run", "text": scene_toml(scene)},
    ]
    return page(scene.title or scene.name, lead, sections, cards=headline_rows(summary), remarks=notes)


def film(maps: "xarray.Dataset") -> dict[str, Any]:
    """Return evenly spaced maps to show with a slider, or the words that they are all the same."""
    count = maps.sizes["time"]
    chosen = np.unique(np.linspace(0, count - 1, min(count, MOST_FRAMES)).round().astype(int))
    values = np.stack([maps["opd"].isel(time=int(number)).values for number in chosen])
    if is_flat(values, "m", _greatest(maps["error"])):
        return {
            "paragraphs": ["The optical path difference is the same in all pixels and snapshots, but for rounding."]
        }
    limit = float(np.nanpercentile(np.abs(values), 99.5))
    return {
        "film": {
            "frames": [embedded(_frame(one, limit)) for one in values],
            "times": [f"snapshot {number}, {float(maps.time[int(number)]):.6g} s" for number in chosen],
            "caption": f"Blue to red: {-limit * 1e9:.3g} to {limit * 1e9:.3g} nm; x to the right, y upward.",
        }
    }


def _frame(values: np.ndarray, limit: float) -> bytes:
    """Return a map as a PNG file, enlarged by a whole factor, y upward."""
    from matplotlib import colormaps
    from PIL import Image

    colours = colormaps["RdBu_r"](0.5 + 0.5 * np.clip(values / limit, -1.0, 1.0))
    colours[~np.isfinite(values)] = 1.0
    pixels = (255.0 * colours[::-1, :, :3]).round().astype(np.uint8)
    times = max(1, -(-FRAME_SIDE // max(pixels.shape[:2])))
    buffer = io.BytesIO()
    Image.fromarray(pixels.repeat(times, axis=0).repeat(times, axis=1)).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def _pictures(maps: "xarray.Dataset", found: "xarray.Dataset") -> list[Picture]:
    shown: list[Picture] = [
        ("maps", "Steady map, and the rms in time about it", lambda: _maps_figure(found)),
        ("time", "OPD rms and Strehl ratio of each snapshot", lambda: _time_figure(maps)),
    ]
    if "spectrum_opd" in found and not is_flat([0.0, *found.opd_std.values.ravel()], "m"):
        shown.append(("spectra", "Power spectra, with their errors", lambda: _spectra_figure(found)))
    if not is_flat([0.0, *found.opd_rms_aperture.values], "m"):
        shown.append(("aperture", "OPD rms over round parts of the pupil", lambda: _aperture_figure(found)))
    if "pod_mode" in found and not is_flat([0.0, *found.opd_std.values.ravel()], "m"):
        shown.append(("modes", "The first proper orthogonal modes", lambda: _modes_figure(found)))
    return shown


def _greatest(values: Any) -> float:
    """Return the greatest finite value; NaN without one."""
    known = np.asarray(values, float)
    return float(np.nanmax(known)) if np.isfinite(known).any() else float("nan")


def _map(figure: "Figure", axes: Any, bar: Any, found: "xarray.Dataset", values: Any, label: str, even: bool) -> None:
    """Draw a map over the pupil, whose axes are in mm."""
    limit = float(np.nanmax(np.abs(values)))
    scale = {"vmin": -limit, "vmax": limit, "cmap": "RdBu_r"} if even else {"cmap": "viridis"}
    mesh = axes.pcolormesh(1e3 * found.x.values, 1e3 * found.y.values, values, shading="nearest", **scale)
    across, up = axes_of(found)
    axes.set(xlabel=f"{across} [mm]", ylabel=f"{up} [mm]", aspect="equal")
    figure.colorbar(mesh, cax=bar, label=label)


def _maps_figure(found: "xarray.Dataset") -> "Figure":
    figure, [(steady, first), (spread, second)] = panelled_figure(Panel(3.4, 3.4, bar=True), Panel(3.4, 3.4, bar=True))
    for axes, bar, name, words, even in (
        (steady, first, "opd_mean", "steady OPD", True),
        (spread, second, "opd_std", "rms in time", False),
    ):
        values = found[name].values
        if not is_flat(values, "m", STANDARD_ERRORS * _greatest(found[f"{name}_error"])):
            _map(figure, axes, bar, found, 1e9 * values, f"{words} [nm]", even)
            continue
        middle = 0.0 if even else 1e9 * float(np.nanmedian(values)) if np.isfinite(values).any() else float("nan")
        say_flat(axes, f"{words}: {middle:.3g} nm everywhere,\nbut for rounding", bar)
    return figure


def _time_figure(maps: "xarray.Dataset") -> "Figure":
    figure, [(rms, _), (ratio, _)] = panelled_figure(Panel(4.4, 2.8), Panel(4.4, 2.8))
    time = 1e3 * maps.time.values
    for axes, name, words, colour, unit, factor in (
        (rms, "opd_rms", "OPD rms, tilt removed", "#0b6e99", "m", 1e9),
        (ratio, "strehl", "Strehl ratio", "#c2410c", "1", 1.0),
    ):
        values = maps[name].values
        label = f"{words} [nm]" if factor != 1.0 else words
        if is_flat(values, unit, _greatest(maps[f"{name}_error"])):
            say_flat(axes, f"{label}: {factor * _greatest(values):.3g} at all times,\nbut for rounding")
            continue
        axes.plot(time, factor * values, color=colour, linewidth=1.0)
        axes.set(xlabel="time [ms]", ylabel=label)
    return figure


def _spectra_figure(found: "xarray.Dataset") -> "Figure":
    figure, [(opd, _), (tilt, _)] = panelled_figure(Panel(4.4, 3.2), Panel(4.4, 3.2))
    strouhal = "strouhal" in found.coords
    places = found["strouhal" if strouhal else "frequency"].values
    rows: list[tuple[Any, str, str, str, float]] = [
        (opd, "spectrum_opd", "OPD", "#0b6e99", 1e18),
        (tilt, "spectrum_jitter_x", "tilt along x", "#0b6e99", 1e12),
        (tilt, "spectrum_jitter_y", "tilt along y", "#c2410c", 1e12),
    ]
    for axes, name, words, colour, factor in rows:
        values, error = (factor * found[one].values[1:] for one in (name, f"{name}_error"))
        error *= STANDARD_ERRORS
        if not (values > 0.0).any():
            continue
        axes.loglog(places[1:], values, color=colour, linewidth=1.2, label=words)
        axes.fill_between(places[1:], np.maximum(values - error, 0.1 * values), values + error, color=colour, alpha=0.2)
    words = "Strouhal number f D / U" if strouhal else "frequency [Hz]"
    opd.set(xlabel=words, ylabel="nm²/Hz")
    tilt.set(xlabel=words, ylabel="µrad²/Hz")
    for axes in (opd, tilt):
        plain_decades(axes)
        if axes.get_legend_handles_labels()[0]:
            axes.legend()
    return figure


def _aperture_figure(found: "xarray.Dataset") -> "Figure":
    figure, [(axes, _)] = panelled_figure(Panel(6.0, 3.0))
    error = 1e9 * STANDARD_ERRORS * np.nan_to_num(found.opd_rms_aperture_error.values)
    axes.errorbar(
        1e3 * found.aperture.values, 1e9 * found.opd_rms_aperture.values, error, marker="o", capsize=3, color="#0b6e99"
    )
    axes.set(xlabel="diameter [mm]", ylabel="OPD rms, tilt removed [nm]")
    return figure


def _modes_figure(found: "xarray.Dataset") -> "Figure":
    count = min(3, int((found.pod_energy.values > 0.0).sum()))
    figure, panels = panelled_figure(*[Panel(2.6, 2.6, bar=True)] * count)
    for k, (axes, bar) in enumerate(panels):
        error = 100.0 * STANDARD_ERRORS * float(found.pod_share_error[k])
        share = Quantity(100.0 * float(found.pod_share[k]), error).text()
        _map(figure, axes, bar, found, found.pod_mode.values[k], "", True)
        axes.set_title(f"{share} %", y=1.0)
    return figure
