"""Run a series job: OPD maps of flow snapshots, their statistics, and a report.

DIR/series.zarr holds the maps, DIR/statistics.nc their statistics with standard errors, DIR/summary.json the scalar
statistics, each with its error, which is two standard errors, and DIR/report.html figures and a film.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels import __version__
from aerokernels.display.plain_text import plain_json
from aerokernels.files.writing import only_writer
from aerokernels.flow import GridMesh, Series, open_series
from aerokernels.jobs.store import (
    MAPS_FILE,
    REPORT_FILE,
    SUMMARY_FILE,
    check_output_folder,
    replace_result,
    to_json,
    write_text,
)
from aerokernels.pupils import direction_of
from aerokernels.scene import Scene, warn_of_unused
from aerokernels.scene.file_table import FileTable
from aerokernels.scene.pupil_table import axis_words
from aerokernels.series import optical_series, statistics

if TYPE_CHECKING:
    import xarray

Progress = Callable[[str, float], None]
STATISTICS_FILE = "statistics.nc"
MAPS_SHARE = 0.9  # share of the job's time that the maps take


def scene_series(scene: Scene) -> Series:
    """Open the snapshots of a scene.

    Raises:
        ValueError: The scene names no snapshots, or they cannot be opened; the message names the key.
    """
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
    angles = (
        getattr(scene.pupil if getattr(scene.series, name) is None else scene.series, name)
        for name in ("azimuth", "elevation")
    )
    return direction_of(*angles)


def run_series(scene: Scene, out: Path, progress: Progress | None = None) -> dict[str, Any]:
    """Run the whole job; maps from an interrupted job in the same folder are reused.

    Returns:
        The summary.

    Raises:
        ValueError: The scene, the snapshots or the folder cannot be used; nothing is written then.
        ImportError: Zarr is not installed.
    """
    check_output_folder(out, own=(MAPS_FILE,))
    with only_writer(out):
        return _run_alone(scene, out, progress)


def _run_alone(scene: Scene, out: Path, progress: Progress | None) -> dict[str, Any]:
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
        progress=lambda text, share: report(text, MAPS_SHARE * share),
    )
    report("statistics", MAPS_SHARE)
    again = series if isinstance(series.mesh, GridMesh) and len(series) > 1 else None
    found = statistics(maps, velocity=table.velocity, length=table.length, series=again)
    found.attrs["pupil_axes"] = list(axis_words(scene.view))
    summary = summarise(scene, maps, found)
    from aerokernels.jobs.series_report import series_report

    report("writing the report", 0.95)
    replace_result(out / STATISTICS_FILE, found)
    write_text(
        out / SUMMARY_FILE, plain_json(json.dumps(summary, indent=2, ensure_ascii=False, allow_nan=False)) + "\n"
    )
    write_text(out / REPORT_FILE, series_report(scene, maps, found, summary))
    return summary


def summarise(scene: Scene, maps: "xarray.Dataset", found: "xarray.Dataset") -> dict[str, Any]:
    """Return the scalar statistics with their errors and the provenance; NaN becomes None."""
    names = [str(name) for name in found.data_vars if found[name].ndim == 0 and not str(name).endswith("_error")]
    from aerokernels.jobs.series_report import STANDARD_ERRORS

    errors = np.asarray(maps["error"].values)
    return to_json(
        {
            "scene": scene.name,
            "title": scene.title,
            **{name: float(found[name]) for name in names},
            "errors": {name: STANDARD_ERRORS * float(found[f"{name}_error"]) for name in names},
            "independent_count": found.attrs["independent_count"],
            "drifting": found.attrs["drifting"],
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
