"""`aerokernels run`: run a scene from flow to range, and write the results."""

from pathlib import Path
from typing import Annotated

import typer

from aerokernels.commands._scene import Backend, Device, Precision, Rays, SceneName, Settings, load_scene, naming_scene


def run(
    scene: SceneName,
    out: Annotated[Path, typer.Option(help="Folder for summary.json, result.nc and report.html.")],
    backend: Backend = None,
    device: Device = None,
    precision: Precision = None,
    rays: Rays = None,
    settings: Settings = None,
    no_echo: Annotated[bool, typer.Option("--no-echo", help="Leave out the laser echo and its range.")] = False,
) -> None:
    """Run a scene from its flow to the reported range.

    Compute wavefront, Strehl ratio, echo and range, each number with its error, and write a report. A stage that
    finds nothing, such as an echo that cannot be ranged, does not stop the others. Exit status 3: all files are
    written, but the answer is not meaningful: the error allows any Strehl ratio, or is above the echo's peak.
    """
    from aerokernels.commands._ahead import REPORT, import_ahead
    from aerokernels.commands._output import note
    from aerokernels.commands._progress import shown_progress
    from aerokernels.commands._table import print_table
    from aerokernels.commands._verdict import leave_with
    from aerokernels.files.writing import only_writer
    from aerokernels.jobs.report import headline_rows, remark_rows
    from aerokernels.jobs.run import simulate, write_run
    from aerokernels.jobs.store import check_output_folder

    loaded = load_scene(scene, backend, device, precision, rays, settings)
    check_output_folder(out)
    import_ahead(REPORT)
    with only_writer(out), shown_progress(loaded.name) as progress:
        with naming_scene(scene):
            result = simulate(loaded, progress=progress, with_echo=not no_echo)
        progress("writing the report", 0.9)
        summary = write_run(result, out)
    rows = [*headline_rows(summary), *remark_rows(summary), *_cost_rows(summary)]
    print_table(loaded.title or loaded.name, ("quantity", "value"), rows, summary)
    note(f"wrote {out / 'report.html'}, summary.json and result.nc")
    leave_with(result.verdict)


def _cost_rows(summary: dict) -> list[tuple[str, str]]:
    where = f"{summary['backend']} on {summary['device']}, {summary['precision']}"
    return [
        ("Rays for the Strehl ratio", f"{summary['ray_count']:,} requested, {summary['traced_ray_count']:,} traced"),
        ("Computed by", where),
        ("Time", f"{summary['total_seconds']:.2f} s, of which {summary['compile_seconds']:.2f} s compiling kernels"),
    ]
