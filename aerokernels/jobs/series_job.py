"""Run a series job: OPD maps of flow snapshots, their statistics, and a report."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels import __version__
from aerokernels.display.progress import Progress
from aerokernels.files.writing import only_writer, replacing
from aerokernels.flow import Series, open_series
from aerokernels.jobs.numbers import SERIES_NUMBERS, quantity_of
from aerokernels.jobs.pages.series_page import STANDARD_ERRORS, series_page
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
from aerokernels.scene.file_table import FileTable
from aerokernels.scene.pupil_table import axis_words
from aerokernels.series import optical_series, statistics

if TYPE_CHECKING:
    import xarray

STATISTICS_FILE = "statistics.nc"


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
        write_text(out / REPORT_FILE, series_page(maps, found, summary, scene_toml(scene)).html())
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
