"""Connect to the Dask workers of a running scheduler, or start workers on this machine for the time of a sweep.

Workers started here are processes with one thread, each with a GPU of its own if there are GPUs, under a nanny that
replaces a worker that dies.
"""

import contextlib
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from aerokernels import __version__
from aerokernels.process.machine import python_child

if TYPE_CHECKING:
    from distributed import Client

ANSWER_WITHIN = 10.0  # [s] timeout for a scheduler to answer
START_WITHIN = 120.0  # [s] timeout for the first worker started here
RESTARTS = 3  # restarts of each worker's nanny


def worker_version() -> str:
    """Return the version of aerokernels on a worker."""
    from aerokernels import __version__

    return __version__


def _never() -> bool:
    return False


@contextlib.contextmanager
def connected(scheduler: Any, environments: Sequence[dict[str, str]]) -> Iterator[tuple["Client", Callable[[], bool]]]:
    """Yield a client of a scheduler, or of one started here with a worker for each environment.

    Also yield a function that returns whether the workers are lost for good; workers not started here may always come
    back. The client is not set as the default: Dask and xarray would go on using it after its scheduler is lost.

    Args:
        scheduler: The address of a running scheduler, a client or a cluster; None starts a scheduler.
        environments: Variables to add to the environment of each worker that is started.

    Raises:
        ImportError: Dask is not installed.
        ValueError: No scheduler answers at that address, or its workers have another version of aerokernels.
    """
    try:
        import distributed
    except ImportError:
        raise ImportError(
            "executor 'dask' needs Dask: pip install 'aerokernels[dask]', or take executor 'local'"
        ) from None
    given_up: Callable[[], bool] = _never
    with contextlib.ExitStack() as ending:
        if scheduler is None:
            cluster = ending.enter_context(
                distributed.LocalCluster(n_workers=0, processes=True, host="127.0.0.1", dashboard_address=None)
            )
            given_up = ending.enter_context(_workers(cluster.scheduler_address, environments))
            client = ending.enter_context(distributed.Client(cluster, set_as_default=False))
            try:
                client.wait_for_workers(1, timeout=START_WITHIN)
            except TimeoutError:
                raise RuntimeError(f"no Dask worker started within {START_WITHIN:g} s on this machine") from None
        elif hasattr(scheduler, "submit"):
            client = scheduler
            _check_versions(client, str(client.scheduler.address if client.scheduler else client))
        else:
            try:
                client = distributed.Client(scheduler, timeout=ANSWER_WITHIN, set_as_default=False)
                ending.enter_context(client)
            except (OSError, TimeoutError, ValueError) as fault:
                raise ValueError(
                    f"scheduler {scheduler}: no Dask scheduler answers there ({' '.join(str(fault).split())[:200]}); "
                    "start one with `dask scheduler`, workers with `dask worker ADDRESS`, and give its address"
                ) from None
            _check_versions(client, scheduler)
        yield client, given_up


def _check_versions(client: "Client", scheduler: str) -> None:
    try:
        versions = client.run(worker_version)
    except Exception as fault:
        raise ValueError(
            f"scheduler {scheduler}: its workers cannot import aerokernels ({type(fault).__name__}: {fault}): "
            "install the same version there"
        ) from None
    for worker, version in versions.items():
        if version != __version__:
            raise ValueError(
                f"scheduler {scheduler}: worker {worker} has aerokernels {version}, this is {__version__}: "
                "install the same version there"
            )


@contextlib.contextmanager
def _workers(address: str, environments: Sequence[dict[str, str]]) -> Iterator[Callable[[], bool]]:
    """Run worker processes on this machine for a scheduler; restart a nanny that dies up to `RESTARTS` times.

    Yields a function that returns whether all of them have died for good.
    """

    def start(number: int) -> subprocess.Popen:
        options = ["--nthreads", "1", "--no-dashboard", "--memory-limit", "0", "--death-timeout", "60"]
        return subprocess.Popen(
            **python_child(["-m", "distributed.cli.dask_worker", address, *options], environments[number]),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # keep Ctrl-C from the workers: the sweep ends them itself
        )

    processes = [start(number) for number in range(len(environments))]
    restarts = [0] * len(processes)
    over = threading.Event()

    def given_up() -> bool:
        return min(restarts) >= RESTARTS and all(process.poll() is not None for process in processes)

    def watch() -> None:
        while not over.wait(1.0):
            for number, process in enumerate(processes):
                if process.poll() is not None and restarts[number] < RESTARTS and not over.is_set():
                    restarts[number] += 1
                    processes[number] = start(number)

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield given_up
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
