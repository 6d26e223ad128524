"""Run sweeps: a scene for many values of its keys, on many processes, into one dataset; resume interrupted sweeps."""

import contextlib
import datetime
import platform
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aerokernels.display.progress import Progress, shows_progress
from aerokernels.files.writing import only_writer
from aerokernels.inputs.arguments import checked
from aerokernels.inputs.checks import check_path
from aerokernels.inputs.kinds import as_whole
from aerokernels.jobs.store import REPORT_FILE, check_output_folder, read_result, replace_result, write_text
from aerokernels.jobs.sweeps.definition import Definition, checked_scenes, define
from aerokernels.jobs.sweeps.records import (
    CASES_FILE,
    DATASET_FILE,
    DEFINITION_FILE,
    Records,
    check_same,
    read_definition,
    sweep_dataset,
    write_definition,
)
from aerokernels.scene import Scene, warn_of_unused

if TYPE_CHECKING:
    import xarray


EXECUTORS = ("local", "dask")


@shows_progress("sweep")
@checked
def sweep(
    scene: Scene | str | Path,
    vary: Mapping[str, Iterable[Any]],
    *,
    executor: Any = "local",
    out: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    settings: Mapping[str, Any] | None = None,
    zip: bool = False,
    retry_failed: bool = False,
    progress: Progress | None = None,
) -> "xarray.Dataset":
    """Run a scene for every combination of values of its keys.

    Args:
        scene: The scene, the path of its TOML file, or the name of a shipped one.
        vary: Values by dotted key, {"target.tilt": ["0 deg", "10 deg"]}: numbers in SI units, or texts with a unit.
        executor: "local": processes of this machine; "dask": Dask workers, of this machine or of a scheduler; or any
            `concurrent.futures.Executor`, `distributed.Client` or Dask cluster, whose workers are used.
        out: Folder for sweep.nc and the finished cases. An interrupted sweep is resumed from there, and a finished one
            is read from there. None: nothing is stored.
        workers: Processes on this machine; None: one for each GPU, or, without GPUs, for each core.
        scheduler: Address of a running Dask scheduler, "tcp://host:8786", whose workers are used.
        settings: Changes to the scene for all cases, by dotted key.
        zip: Whether the keys take their values in parallel, instead of in every combination.
        retry_failed: Whether cases that failed before are computed again.
        progress: Called with a description of the progress and the share of finished cases; None shows a bar in
            terminals and notebooks.

    Returns:
        One dataset: the numbers of summary.json with a dimension per key, or the dimension "case" for `zip`;
        coordinates are the keys, in SI units. A failed case has NaN, `failed` is true, and `failures` holds the reason.

    Raises:
        TypeError: An argument of the wrong kind.
        ValueError: A value that the scene rejects; a folder that holds another sweep or in which another process is
            writing; no such device or scheduler.
        ImportError: executor="dask" without Dask.
    """
    check_options(executor, workers, scheduler)
    if hasattr(executor, "nthreads") or hasattr(executor, "scheduler_address"):  # a client or a cluster of Dask
        executor, scheduler = "dask", executor
    definition = define(scene, vary, settings=settings, together=zip)
    with contextlib.ExitStack() as ending:
        folder = (
            check_path(out, "out") if out is not None else Path(ending.enter_context(tempfile.TemporaryDirectory()))
        )
        if not is_finished(definition, folder, retry_failed):
            run_sweep(definition, folder, executor, workers, scheduler, retry_failed, progress)
        return read_result(folder / DATASET_FILE)


def is_finished(definition: Definition, folder: Path, retry_failed: bool = False) -> bool:
    """Whether a folder holds this sweep, finished.

    Raises:
        ValueError: The folder holds another sweep.
    """
    check_output_folder(folder, own=(DEFINITION_FILE, CASES_FILE, DATASET_FILE))
    found = read_definition(folder)
    if found is None:
        return False
    check_same(folder, found, definition.described())
    records = Records(folder)
    if retry_failed and any("error" in record for record in records.done.values()):
        return False
    return len(records.done) == definition.case_count and (folder / DATASET_FILE).is_file()


def run_sweep(
    definition: Definition,
    folder: Path,
    executor: Any = "local",
    workers: int | None = None,
    scheduler: Any = None,
    retry_failed: bool = False,
    progress: Progress | None = None,
) -> None:
    """Compute the cases of a sweep that a folder does not hold yet, and write the dataset and the report.

    Raises:
        ValueError: See `sweep`; nothing is written then.
    """
    from aerokernels.jobs.pages.sweep_page import sweep_page
    from aerokernels.jobs.sweeps.case import make_cases
    from aerokernels.jobs.sweeps.executors import outcomes

    progress = progress or (lambda text, share: None)
    with only_writer(folder):
        described = definition.described()
        scenes, faults = checked_scenes(definition)
        good = [scene for scene in scenes if scene is not None]
        warn_of_unused(good[0], "run")
        devices = _check_devices(good)
        found = read_definition(folder)
        if found is not None:
            check_same(folder, found, described)
        records = Records(folder)
        waiting = [
            case
            for case in make_cases(scenes)
            if case.number not in records.done or (retry_failed and "error" in records.done[case.number])
        ]
        computed = outcomes(waiting, executor, workers, scheduler, devices)
        with contextlib.closing(computed):
            next(computed)  # starts the executor, whose errors must come before anything is written
            folder.mkdir(parents=True, exist_ok=True)
            if found is None:
                write_definition(folder, described)
            if retry_failed:
                records.forget_failed()
            with records.writing():
                for number, text in faults.items():
                    records.add(number, {"error": text})
                _collect(computed, records, definition.case_count, progress)
        progress("writing the dataset", 1.0)
        provenance = {
            "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            "machine": f"{platform.node()}, {platform.machine()}, Python {platform.python_version()}",
            "executor": executor if isinstance(executor, str) else type(executor).__name__,
        }
        dataset = sweep_dataset(definition, described, good[0], records.done, provenance)
        replace_result(folder / DATASET_FILE, dataset)
        write_text(folder / REPORT_FILE, sweep_page(dataset, definition).html())


def _check_devices(scenes: Iterable[Scene]) -> set[str | None]:
    """Reject a backend or device that is not available, before any case is computed; return the devices named."""
    from aerokernels.tracing.engines.choice import choose_backend

    asked = {(scene.trace.backend, scene.trace.device) for scene in scenes}
    for backend, device in sorted(asked, key=str):
        try:
            choose_backend(backend, device)
        except ValueError as fault:
            raise ValueError(f"trace.backend = {backend!r}, trace.device = {device!r}: {fault}") from None
    return {device for _, device in asked}


def _collect(computed: Iterator, records: Records, total: int, progress: Progress) -> None:
    """Store each case when it is finished, and report the progress."""
    begin, before = time.monotonic(), len(records.done)

    def report() -> None:
        done, failed = len(records.done), sum("error" in record for record in records.done.values())
        text = f"{done} of {total} cases" + (f", {failed} failed" if failed else "")
        if before < done < total:
            left = (time.monotonic() - begin) / (done - before) * (total - done)
            text += f", about {datetime.timedelta(seconds=round(left))} left"
        progress(text, done / total)

    report()
    for number, outcome in computed:
        if records.add(number, outcome):
            report()


def check_options(executor: Any, workers: int | None, scheduler: Any) -> None:
    """Reject options that do not go together.

    Raises:
        TypeError: An executor of the wrong kind.
        ValueError: No such executor, a scheduler without Dask or together with `workers`, fewer than 1 worker.
    """
    if isinstance(executor, str) and executor not in EXECUTORS:
        raise ValueError(f"executor {executor!r}: choose one of {', '.join(EXECUTORS)}")
    if not isinstance(executor, str) and not hasattr(executor, "submit") and not hasattr(executor, "scheduler_address"):
        raise TypeError(
            "executor must be 'local', 'dask', a concurrent.futures.Executor, a distributed.Client or a cluster, "
            f"got {type(executor).__name__}"
        )
    if scheduler is not None and not isinstance(executor, str):
        raise ValueError("executor has its workers already: leave scheduler out")
    if scheduler is not None and executor != "dask":
        raise ValueError(f"scheduler {scheduler} needs the executor dask: give it, or leave the scheduler out")
    if scheduler is not None and workers is not None:
        raise ValueError("workers are started on this machine, and a scheduler has its own: give one of the two")
    if workers is not None and (as_whole(workers) or 0) < 1:
        raise ValueError(f"workers = {workers}: give a whole number of at least 1, or leave it out")
