"""`aerokernels series`: OPD maps and statistics of snapshots of a flow in time."""

from pathlib import Path
from typing import Annotated

import typer

from aerokernels.commands._scene import Backend, Device, Precision, SceneName, Settings, load_scene, naming_scene


def series(
    scene: SceneName,
    out: Annotated[Path, typer.Option(help="Folder for series.zarr, statistics.nc, summary.json and report.html.")],
    backend: Backend = None,
    device: Device = None,
    precision: Precision = None,
    settings: Settings = None,
) -> None:
    """Compute OPD maps and statistics of flow snapshots.

    The table [series] of the scene names the snapshots; the results include a report. An interrupted job resumes at
    the snapshot where it stopped. Exit status 3: all files are written, but the error allows any mean Strehl ratio.
    """
    from aerokernels.commands._output import note
    from aerokernels.commands._progress import every_tenth, shown_progress
    from aerokernels.commands._table import print_table
    from aerokernels.commands._verdict import leave_with
    from aerokernels.display.quantities import judge
    from aerokernels.jobs.numbers import quantity_of
    from aerokernels.jobs.series_job import headline_rows, run_series

    loaded = load_scene(scene, backend, device, precision, None, settings)
    with shown_progress(loaded.name) as progress, naming_scene(scene):
        summary = run_series(loaded, out, every_tenth(progress))
    print_table(loaded.title or loaded.name, ("quantity", "value"), headline_rows(summary))
    note(f"wrote {out / 'report.html'}, summary.json, statistics.nc and series.zarr")
    leave_with(judge({"mean Strehl ratio": quantity_of(summary, "strehl")}))
