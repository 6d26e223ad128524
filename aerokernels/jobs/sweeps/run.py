"""Run sweeps: a scene for many values of its keys, on many processes, into one dataset; resume interrupted sweeps."""

import contextlib
import datetime
import platform
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aerokernels.files.writing import only_writer
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
    write_definition,
)
from aerokernels.scene import Scene, warn_of_unused

if TYPE_CHECKING:
    import xarray


Progress = Callable[[str, float], None]
EXECUTORS = ("local", "dask")


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
    sample: str | int | None = None,
    seed: int = 0,
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
        sample: "lhs:N": N cases of a Latin hypercube between the two numbers given for each key.
        seed: Seed of the Latin hypercube.
        retry_failed: Whether cases that failed before are computed again.
        progress: Called with a description of the progress and the share of finished cases.

    Returns:
        One dataset: the numbers of summary.json with a dimension per key, or the dimension "case" for `zip` and
        `sample`; coordinates are the keys, in SI units. A failed case has NaN, `failed` is true, and `failures` holds
        the reason.

    Raises:
        TypeError: An argument of the wrong kind.
        ValueError: A value that the scene rejects; a folder that holds another sweep or in which another process is
            writing; no such device or scheduler.
        ImportError: executor="dask" without Dask.
    """
    check_options(executor, workers, scheduler)
    if hasattr(executor, "nthreads") or hasattr(executor, "scheduler_address"):  # a client or a cluster of Dask
        executor, scheduler = "dask", executor
    definition = define(scene, vary, settings=settings, together=zip, sample=sample, seed=seed)
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
    progress = progress or (lambda text, share: None)
    with only_writer(folder):
        described = definition.described()
        scenes, faults = checked_scenes(definition)
        warn_of_unused(next(scene for scene in scenes if scene is not None), "run")
        devices = _check_devices(scenes)
        from aerokernels.jobs.sweeps.case import make_cases
        from aerokernels.jobs.sweeps.executors import outcomes

        cases = make_cases(scenes)
        found = read_definition(folder)
        if found is not None:
            check_same(folder, found, described)
        records = Records(folder)
        finished = set(records.done)
        if retry_failed:
            finished = {number for number, record in records.done.items() if "error" not in record}
        waiting = [case for case in cases if case.number not in finished]
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
            _write(definition, described, scenes, records, folder, executor)


def _collect(computed: Iterator, records: Records, total: int, progress: Progress) -> None:
    """Store each case when it is finished, and report the progress."""
    begin, before = time.monotonic(), len(records.done)
    progress(_progress_text(records, total, None), before / total)
    for number, outcome in computed:
        if records.add(number, outcome):
            each = (time.monotonic() - begin) / (len(records.done) - before)
            progress(_progress_text(records, total, each * (total - len(records.done))), len(records.done) / total)


def _progress_text(records: Records, total: int, left: float | None) -> str:
    failed = sum("error" in record for record in records.done.values())
    text = f"{len(records.done)} of {total} cases" + (f", {failed} failed" if failed else "")
    if left is None or len(records.done) == total:
        return text
    return f"{text}, about {_duration(left)} left"


def _duration(seconds: float) -> str:
    for size, unit in ((86400.0, "d"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"


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


def _check_devices(scenes: list[Scene | None]) -> set[str | None]:
    """Reject a backend or device that is not available, before any case is computed; return the devices named."""
    from aerokernels.tracing.engines.choice import choose_backend

    asked = {(scene.trace.backend, scene.trace.device) for scene in scenes if scene is not None}
    for backend, device in sorted(asked, key=str):
        try:
            choose_backend(backend, device)
        except ValueError as fault:
            raise ValueError(f"trace.backend = {backend!r}, trace.device = {device!r}: {fault}") from None
    return {device for _, device in asked}


def _write(
    definition: Definition,
    described: Mapping[str, Any],
    scenes: list[Scene | None],
    records: Records,
    folder: Path,
    executor: Any,
) -> None:
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    provenance = {
        "created": now,
        "machine": f"{platform.node()}, {platform.machine()}, Python {platform.python_version()}",
        "executor": executor if isinstance(executor, str) else type(executor).__name__,
    }
    from aerokernels.jobs.sweeps.dataset import sweep_dataset
    from aerokernels.jobs.sweeps.report import sweep_report

    dataset = sweep_dataset(definition, described, scenes, records.done, provenance)
    replace_result(folder / DATASET_FILE, dataset)
    write_text(folder / REPORT_FILE, sweep_report(dataset, definition))
