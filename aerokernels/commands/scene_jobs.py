"""Commands on a scene: run, explain, strehl, series, sweep."""

from pathlib import Path
from typing import Annotated

import typer

from aerokernels.commands._output import (
    REPORT,
    every_tenth,
    import_ahead,
    leave_with,
    note,
    print_table,
    result,
    shown_progress,
    warn,
)
from aerokernels.commands._scene import (
    Backend,
    Device,
    Precision,
    Rays,
    SceneName,
    Settings,
    naming_scene,
    parse_vary,
    scene_changes,
)


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
    from aerokernels.files.writing import only_writer
    from aerokernels.jobs.numbers import table_rows
    from aerokernels.jobs.run import simulate, write_run
    from aerokernels.jobs.store import check_output_folder
    from aerokernels.scene import Scene

    loaded = Scene.load(scene, scene_changes(backend, device, precision, rays, settings))
    check_output_folder(out)
    import_ahead(REPORT)
    with only_writer(out), shown_progress(loaded.name) as progress:
        with naming_scene(scene):
            result = simulate(loaded, progress=progress, with_echo=not no_echo)
        progress("writing the report", 0.9)
        summary = write_run(result, out)
    print_table(loaded.title or loaded.name, ("quantity", "value"), table_rows(summary), summary)
    note(f"wrote {out / 'report.html'}, summary.json and result.nc")
    leave_with(result.verdict)


def explain(
    scene: SceneName,
    backend: Backend = None,
    device: Device = None,
    precision: Precision = None,
    rays: Rays = None,
    settings: Settings = None,
) -> None:
    """Show what a run would do, and why.

    Flow, region, grid, method, ray counts, predicted cost and errors.
    """
    from aerokernels.jobs.explain import explanation
    from aerokernels.scene import Scene, warn_of_unused

    loaded = Scene.load(scene, scene_changes(backend, device, precision, rays, settings))
    warn_of_unused(loaded, "run")
    with naming_scene(scene):
        rows = explanation(loaded)
    print_table(f"What `aerokernels run {scene}` would do", ("what", "how"), rows)


def strehl(
    scene: SceneName,
    backend: Backend = None,
    device: Device = None,
    precision: Precision = None,
    rays: Rays = None,
    settings: Settings = None,
) -> None:
    """Print the Strehl ratio with its error: 0.9779 +- 0.0041.

    It is that of a plane wave through the scene's pupil, from the direction in which the pupil looks. Computing the
    error takes some hundred more rays, less than a second. Exit status 3: the error allows any ratio from 0
    to 1.
    """
    from aerokernels.jobs.run import scene_strehl
    from aerokernels.prepare import prepare_field
    from aerokernels.scene import Scene, warn_of_unused

    loaded = Scene.load(scene, scene_changes(backend, device, precision, rays, settings))
    warn_of_unused(loaded, "strehl")
    with naming_scene(scene):
        estimate = scene_strehl(loaded, prepare_field(loaded).field)
    results = estimate.quantities
    numbers = {name: {"value": one.value, "error": one.error, "unit": one.unit} for name, one in results.items()}
    result(str(results["value"]), {"scene": loaded.name, **numbers, "verdict": estimate.verdict.level})
    leave_with(estimate.verdict)


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
    from aerokernels.display.quantities import judge
    from aerokernels.jobs.numbers import quantity_of
    from aerokernels.jobs.series_job import headline_rows, run_series
    from aerokernels.scene import Scene

    loaded = Scene.load(scene, scene_changes(backend, device, precision, None, settings))
    with shown_progress(loaded.name) as progress, naming_scene(scene):
        summary = run_series(loaded, out, every_tenth(progress))
    print_table(loaded.title or loaded.name, ("quantity", "value"), headline_rows(summary))
    note(f"wrote {out / 'report.html'}, summary.json, statistics.nc and series.zarr")
    leave_with(judge({"mean Strehl ratio": quantity_of(summary, "strehl")}))


def sweep(
    scene: SceneName,
    vary: Annotated[
        list[str],
        typer.Option(
            metavar="KEY=V1,V2,...",
            help="A key and its values, or KEY=LOW:HIGH:COUNT for evenly spaced values. Repeatable.",
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder for sweep.nc, report.html and the finished cases.")],
    zip_: Annotated[
        bool, typer.Option("--zip", help="Take the keys' values in parallel, not in every combination.")
    ] = False,
    executor: Annotated[str, typer.Option(help="local or dask.")] = "local",
    workers: Annotated[
        int | None, typer.Option(help="Processes on this machine [default: one per GPU, or, without GPUs, per core].")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Address of a running Dask scheduler.")
    ] = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Compute failed cases again.")] = False,
    backend: Backend = None,
    device: Device = None,
    precision: Precision = None,
    rays: Rays = None,
    settings: Settings = None,
) -> None:
    """Run a scene for many values of its keys.

    Every combination of the values is a case, and all cases make one labelled dataset. An interrupted sweep resumes
    where it stopped; a finished one does nothing. A case that fails is recorded with its error and does not stop
    the others. Exit status 1: all cases failed; 3: no case that succeeded is meaningful given its errors.
    """
    from aerokernels.jobs.sweeps.definition import define
    from aerokernels.jobs.sweeps.run import check_options, is_finished, run_sweep

    check_options(executor, workers, scheduler)
    changes = scene_changes(backend, device, precision, rays, settings)
    definition = define(scene, parse_vary(vary), settings=changes, together=zip_)
    if is_finished(definition, out, retry_failed):
        note(f"nothing to do: all {definition.case_count} cases in {out} are finished")
    else:
        with shown_progress(Path(scene).stem) as progress:
            run_sweep(definition, out, executor, workers, scheduler, retry_failed, every_tenth(progress))
    _finish(definition.case_count, out)


def _finish(total: int, out: Path) -> None:
    """Print how many cases succeeded, and the first failures, of a whole case and of a stage of one."""
    from aerokernels.display.quantities import WARNING, WORTHLESS, Verdict
    from aerokernels.jobs.sweeps.records import DATASET_FILE, Records, failure_of

    done = Records(out).done
    failed: dict[str, str] = {}
    incomplete: dict[str, str] = {}
    worthless: dict[str, str] = {}
    for number, record in sorted(done.items()):
        if why := failure_of(record):
            (failed if "error" in record else incomplete)[str(number)] = why
        summary = record.get("summary") or {}
        if summary.get("verdict") == WORTHLESS:
            worthless[str(number)] = str(next(iter(summary.get("warnings") or ()), ""))
    text = f"{total - len(failed)} of {total} cases succeeded: {out / DATASET_FILE} and report.html"
    result(text, {"case_count": total, "failed": failed, "incomplete": incomplete, "out": str(out)})
    for some, what in ((failed, "failed"), (incomplete, "lack some numbers")):
        if some:
            first = next(iter(some))
            warn(f"warning: {len(some)} of {total} cases {what}; the first, case {first}: {some[first]}")
    if len(failed) == total:
        raise typer.Exit(1)
    if worthless:
        first = next(iter(worthless))
        level = WORTHLESS if len(worthless) == total - len(failed) else WARNING
        leave_with(Verdict(level, f"{len(worthless)} of {total} cases; the first, case {first}: {worthless[first]}"))


COMMANDS = {"run": run, "explain": explain, "strehl": strehl, "series": series, "sweep": sweep}
