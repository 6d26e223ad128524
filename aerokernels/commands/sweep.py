"""`aerokernels sweep`: run a scene for many values of its keys."""

from pathlib import Path
from typing import Annotated

import typer

from aerokernels.commands._scene import Backend, Device, Precision, Rays, SceneName, Settings, scene_changes


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
    sample: Annotated[
        str | None,
        typer.Option(metavar="lhs:N", help="N random cases, a Latin hypercube between each key's two values."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of --sample.")] = 0,
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
    from aerokernels.commands._output import note
    from aerokernels.commands._vary import parse_vary
    from aerokernels.jobs.sweeps.definition import define
    from aerokernels.jobs.sweeps.run import check_options, is_finished, run_sweep

    check_options(executor, workers, scheduler)
    changes = scene_changes(backend, device, precision, rays, settings)
    definition = define(scene, parse_vary(vary), settings=changes, together=zip_, sample=sample, seed=seed)
    if is_finished(definition, out, retry_failed):
        note(f"nothing to do: all {definition.case_count} cases in {out} are finished")
    else:
        from aerokernels.commands._progress import every_tenth, shown_progress

        with shown_progress(Path(scene).stem) as progress:
            run_sweep(definition, out, executor, workers, scheduler, retry_failed, every_tenth(progress))
    _finish(definition.case_count, out)


def _finish(total: int, out: Path) -> None:
    """Print how many cases succeeded, and the first failures, of a whole case and of a stage of one.

    Raises:
        typer.Exit: Every case failed, or no other is meaningful.
    """
    from aerokernels.commands._output import result, warn
    from aerokernels.commands._verdict import leave_with
    from aerokernels.display.quantities import WARNING, WORTHLESS, Verdict
    from aerokernels.jobs.sweeps.dataset import failure_of
    from aerokernels.jobs.sweeps.records import DATASET_FILE, Records

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
