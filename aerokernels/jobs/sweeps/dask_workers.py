"""Cases on Dask workers: of a scheduler that runs somewhere, or started here for the time of a sweep.

Workers started here are processes of one thread, each with its GPU where there are any, under a nanny that replaces a
worker that dies. Dask gives the cases of a dead worker to another; a case at which several workers died has failed.
"""

import contextlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from aerokernels import __version__
from aerokernels.jobs.sweeps.case import Case
from aerokernels.machine import child_environment

if TYPE_CHECKING:
    from distributed import Client

ANSWER_WITHIN = 10.0  # [s] for a scheduler to answer
START_WITHIN = 120.0  # [s] for the first worker started here to be there
RESTARTS = 3  # of each worker's nanny
_one_at_a_time = threading.Lock()


def compute_alone(case: Case) -> dict[str, Any]:
    """Compute a case; a worker of many threads takes one at a time, since a case uses all the cores by itself."""
    from aerokernels.jobs.sweeps.case import compute

    with _one_at_a_time:
        return compute(case)


def worker_version() -> str:
    """The version of aerokernels on a worker."""
    from aerokernels import __version__

    return __version__


@contextlib.contextmanager
def connected(scheduler: Any, environments: Sequence[dict[str, str]]) -> Iterator["Client"]:
    """A client of a scheduler, or of one started here with a worker for each environment.

    Args:
        scheduler: The address of a running scheduler, a client or a cluster; None: one is started.
        environments: What to add to the environment of each worker that is started.

    Raises:
        ImportError: No Dask.
        ValueError: No scheduler at that address, or workers of another version of aerokernels.
    """
    try:
        import distributed
    except ImportError:
        raise ImportError(
            "executor 'dask' needs Dask: pip install 'aerokernels[dask]', or take executor 'local'"
        ) from None
    with contextlib.ExitStack() as ending:
        if scheduler is None:
            cluster = ending.enter_context(
                distributed.LocalCluster(n_workers=0, processes=True, host="127.0.0.1", dashboard_address=None)
            )
            ending.enter_context(_workers(cluster.scheduler_address, environments))
            client = ending.enter_context(distributed.Client(cluster))
            try:
                client.wait_for_workers(1, timeout=START_WITHIN)
            except TimeoutError:
                raise RuntimeError(f"no Dask worker started within {START_WITHIN:g} s on this machine") from None
        elif hasattr(scheduler, "submit"):
            client = scheduler
            _check_versions(client, str(client.scheduler.address if client.scheduler else client))
        else:
            try:
                client = ending.enter_context(distributed.Client(scheduler, timeout=ANSWER_WITHIN))
            except (OSError, TimeoutError, ValueError) as fault:
                raise ValueError(
                    f"--scheduler {scheduler}: no Dask scheduler answers there ({' '.join(str(fault).split())[:200]}); "
                    "start one with `dask scheduler`, workers with `dask worker ADDRESS`, and give its address"
                ) from None
            _check_versions(client, scheduler)
        yield client


def _check_versions(client: "Client", scheduler: str) -> None:
    try:
        versions = client.run(worker_version)
    except Exception as fault:
        raise ValueError(
            f"--scheduler {scheduler}: its workers cannot import aerokernels ({type(fault).__name__}: {fault}): "
            "install the same version there"
        ) from None
    for worker, version in versions.items():
        if version != __version__:
            raise ValueError(
                f"--scheduler {scheduler}: worker {worker} has aerokernels {version}, this is {__version__}: "
                "install the same version there"
            )


@contextlib.contextmanager
def _workers(address: str, environments: Sequence[dict[str, str]]) -> Iterator[None]:
    """Worker processes of this machine for a scheduler; a nanny that is killed is started again."""

    def start(number: int) -> subprocess.Popen:
        options = ["--nthreads", "1", "--no-dashboard", "--memory-limit", "0", "--death-timeout", "60"]
        return subprocess.Popen(
            [sys.executable, "-m", "distributed.cli.dask_worker", address, *options],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for the sweep, which ends them
            env=child_environment(environments[number]),
        )

    processes = [start(number) for number in range(len(environments))]
    over = threading.Event()

    def watch() -> None:
        restarts = [0] * len(processes)
        while not over.wait(1.0):
            for number, process in enumerate(processes):
                if process.poll() is not None and restarts[number] < RESTARTS and not over.is_set():
                    restarts[number] += 1
                    processes[number] = start(number)

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        over.set()
        watcher.join()
        for process in processes:
            process.terminate()
        deadline = time.monotonic() + 5.0
        for process in processes:
            try:
                process.wait(timeout=max(0.1, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def run_dask(client: "Client", cases: Sequence[Case]) -> Iterator[tuple[int, dict[str, Any]]]:
    """Compute cases on a client's workers; yields the number and the outcome of each as it is done."""
    from distributed import as_completed

    futures = {
        client.submit(compute_alone, case, pure=False, key=f"aerokernels-case-{os.getpid()}-{case.number}"): case.number
        for case in cases
    }
    try:
        for future in as_completed(list(futures)):
            if future.status == "finished":
                outcome = future.result()
            else:
                fault = future.exception()
                text = " ".join(str(fault).split()) if fault is not None else future.status
                outcome = {"error": f"its Dask worker failed: {type(fault).__name__}: {text}"}
            yield futures.pop(future), outcome
            future.release()
    finally:
        client.cancel(list(futures), force=True) if futures else None
