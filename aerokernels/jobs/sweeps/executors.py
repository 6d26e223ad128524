"""Compute the cases of a sweep on worker processes of this machine, on any `concurrent.futures.Executor`, or on Dask.

A worker process takes cases of the same index field as long as there are any. Losing the executor ends the sweep;
cases not computed by then have not failed and are computed when the sweep is resumed.
"""

import contextlib
import ctypes
import multiprocessing
import os
import signal
import sys
import threading
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from typing import TYPE_CHECKING, Any

from aerokernels import __version__
from aerokernels.process.machine import core_count
from aerokernels.tracing.engines.info import cuda_driver_loads

if TYPE_CHECKING:
    from aerokernels.jobs.sweeps.case import Case

Outcomes = Iterator[tuple[int, dict[str, Any]]]
ATTEMPTS = 2  # deaths of workers at which a case fails
ANSWER_WITHIN, START_WITHIN = 10.0, 120.0  # [s] for a Dask scheduler to answer, and for a Dask worker to start here
VISIBLE = "CUDA_VISIBLE_DEVICES"
LOST = (
    "the Dask scheduler is gone, or its client was closed or restarted, or the executor was shut down: the finished "
    "cases are safe, and the same sweep resumes from there"
)
_one_at_a_time = threading.Lock()


def outcomes(
    cases: Sequence["Case"], executor: Any, workers: int | None, scheduler: Any, devices: set[str | None]
) -> Generator[Any, None, None]:
    """Yield None once the workers are there, then the number and the outcome of each case when it is finished.

    Arguments as for `sweep`; `scheduler` may also be a Dask client or a cluster, and `devices` are those that the
    cases name. A RuntimeError says that no worker starts, or that the executor is lost.
    """
    if not cases:
        yield None
        return
    with contextlib.ExitStack() as ending:
        if executor == "local":
            yield from _on_processes(cases, worker_environments(workers, len(cases), devices))
        elif executor == "dask":
            environments = worker_environments(workers, len(cases), devices) if scheduler is None else []
            client = ending.enter_context(_dask_client(scheduler, environments))
            yield None

            def check() -> None:
                if client.status not in ("running", "connecting"):
                    raise RuntimeError(LOST)

            yield from _on_executor(cases, client.get_executor(pure=False), check)
        else:
            yield None
            yield from _on_executor(cases, executor, lambda: None)


def compute_alone(case: "Case") -> dict[str, Any]:
    """Compute a case; a worker with several threads computes one case at a time, since a case uses all cores."""
    from aerokernels.jobs.sweeps.case import compute

    with _one_at_a_time:
        return compute(case)


def _on_executor(cases: Sequence["Case"], executor: Executor, check: Callable[[], None]) -> Outcomes:
    """Compute cases by an executor; `check` raises a RuntimeError if it is lost."""
    futures = {executor.submit(compute_alone, case): case.number for case in cases}
    try:
        while futures:
            done, _ = wait(futures, timeout=1.0, return_when=FIRST_COMPLETED)
            if not done:
                check()
                if any(future.cancelled() for future in futures):  # `wait` does not count them as done
                    raise RuntimeError(LOST)
            for future in done:
                try:
                    outcome = future.result()
                except (CancelledError, BrokenExecutor):
                    raise RuntimeError(LOST) from None
                except Exception as fault:
                    check()
                    text = " ".join(str(fault).split())
                    outcome = {"error": f"its worker failed: {type(fault).__name__}: {text}"}
                yield futures.pop(future), outcome
    finally:
        for future in futures:
            future.cancel()


class _Process:
    """A worker process: an executor of a single process, which a dead one is replaced by."""

    def __init__(self, environment: Mapping[str, str]):
        """Start the process without waiting for it."""
        self.environment = environment
        self._start()

    def _start(self) -> None:
        self._pool = ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"))
        with _inherited(self.environment):
            self.ready = self._pool.submit(_prepare)

    def submit(self, case: "Case") -> "Future[dict[str, Any]]":
        """Start to compute a case; on a new process if this one died."""
        try:
            return self._pool.submit(compute_alone, case)
        except BrokenExecutor:
            self._pool.shutdown()
            self._start()
            return self._pool.submit(compute_alone, case)

    def end(self) -> None:
        """End the process, whatever it does."""
        with contextlib.suppress(BrokenExecutor, CancelledError, ProcessLookupError):
            number = self.ready.result()
            self._pool.submit(int)  # raises BrokenExecutor if the process is gone, whose number may be another's
            os.kill(number, signal.SIGTERM)
        self._pool.shutdown(cancel_futures=True)


def _prepare() -> int:
    """Set up a worker process, and return its number.

    Ctrl-C reaches the whole process group, and the parent ends its workers; if the parent is killed, they end too.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(nowhere, stream)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def follow() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
    return os.getpid()


@contextlib.contextmanager
def _inherited(environment: Mapping[str, str]) -> Iterator[None]:
    """Set variables for processes that are started in this block, and hide the main module from them.

    They would import it, so that a script that calls `sweep` would need `if __name__ == "__main__"`. Files of the
    working directory are data to them, not modules.
    """
    module = vars(sys.modules["__main__"])
    hidden: dict[str, Any] = {name: module.pop(name) for name in ("__file__", "__spec__") if name in module}
    module["__spec__"] = None
    set_here = {**environment, "PYTHONSAFEPATH": "1"}
    before = {name: os.environ.get(name) for name in set_here}
    os.environ.update(set_here)
    try:
        yield
    finally:
        module.update(hidden)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _on_processes(cases: Sequence["Case"], environments: Sequence[Mapping[str, str]]) -> Generator[Any, None, None]:
    """Compute cases by worker processes, one for each environment; yields as `outcomes` does."""
    waiting: dict[str, deque[Case]] = {}
    for case in cases:
        waiting.setdefault(case.group, deque()).append(case)
    deaths = Counter[int]()
    running: dict[Future, tuple[_Process, Case]] = {}

    def start(process: _Process, group: str) -> None:
        """Give a process the next case of a group, or, if it has none, of the one with the most cases."""
        queue = waiting.get(group) or max(waiting.values(), key=len)
        if queue:
            case = queue.popleft()
            running[process.submit(case)] = process, case

    with contextlib.ExitStack() as ending:
        processes = [_Process(environment) for environment in environments]
        for process in processes:
            ending.callback(process.end)
        try:
            for process in processes:
                process.ready.result()
        except BrokenExecutor:
            raise RuntimeError("worker processes die as they start: check the free memory") from None
        yield None
        for process in processes:
            start(process, "")
        while running:
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                process, case = running.pop(future)
                outcome = None
                try:
                    outcome = future.result()
                except BrokenExecutor:
                    deaths[case.number] += 1
                    if deaths[case.number] < ATTEMPTS:
                        waiting[case.group].appendleft(case)
                    else:
                        outcome = {"error": f"its worker process died, {ATTEMPTS} times: check the free memory"}
                start(process, case.group)
                if outcome is not None:
                    yield case.number, outcome


@contextlib.contextmanager
def _dask_client(scheduler: Any, environments: Sequence[Mapping[str, str]]) -> Iterator[Any]:
    """Yield a Dask client of a scheduler, or of one started here with a worker for each environment.

    The client is not set as the default: Dask and xarray would go on using it after its scheduler is lost.
    """
    try:
        import distributed
    except ImportError:
        raise ImportError(
            "executor 'dask' needs Dask: pip install 'aerokernels[dask]', or take executor 'local'"
        ) from None
    with contextlib.ExitStack() as ending:
        if hasattr(scheduler, "submit"):
            client = scheduler
        elif scheduler is not None:
            try:
                client = distributed.Client(scheduler, timeout=ANSWER_WITHIN, set_as_default=False)
            except (OSError, TimeoutError, ValueError) as fault:
                raise ValueError(
                    f"scheduler {scheduler}: no Dask scheduler answers there ({' '.join(str(fault).split())[:200]}); "
                    "start one with `dask scheduler`, workers with `dask worker ADDRESS`, and give its address"
                ) from None
            ending.enter_context(client)
        else:
            options = {"nthreads": 1, "memory_limit": 0, "dashboard": False}
            workers = {
                number: {"cls": distributed.Nanny, "options": {**options, "env": dict(environment)}}
                for number, environment in enumerate(environments)
            }
            about = {"cls": distributed.Scheduler, "options": {"host": "127.0.0.1", "port": 0, "dashboard": False}}
            with _inherited({}):
                cluster = ending.enter_context(distributed.SpecCluster(workers, about))
            client = ending.enter_context(distributed.Client(cluster, set_as_default=False))
            try:
                client.wait_for_workers(1, timeout=START_WITHIN)
            except TimeoutError:
                raise RuntimeError(f"no Dask worker started within {START_WITHIN:g} s on this machine") from None
        others = set(client.run(_installed_version).values()) - {__version__}
        if others:
            raise ValueError(
                f"scheduler {client.scheduler.address}: its workers have aerokernels {', '.join(sorted(others))}, this "
                f"is {__version__}: install the same version there"
            )
        yield client


def _installed_version() -> str:
    return __version__


def worker_environments(workers: int | None, case_count: int, devices: set[str | None]) -> list[dict[str, str]]:
    """Return the variables to add to the environment of each worker process of this machine.

    They assign it a GPU, in rotation, unless a case names a device, and its share of the cores. By default there is a
    worker for each GPU, or, without GPUs, for each core up to eight.
    """
    gpus = visible_gpus() if devices <= {None} else []
    cores = core_count()
    count = int(workers) if workers is not None else len(gpus) or min(cores, 8)
    count = max(1, min(count, case_count))
    share = str(max(1, cores // count))
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "POCL_CPU_MAX_CU_COUNT"), share)
    own = {name: value for name, value in threads.items() if name not in os.environ} if count > 1 else {}
    return [{**own, **({VISIBLE: gpus[k % len(gpus)]} if gpus else {})} for k in range(count)]


def visible_gpus() -> list[str]:
    """Return the value of CUDA_VISIBLE_DEVICES that selects each usable GPU, without occupying one by a library."""
    if not cuda_driver_loads():
        return []
    named = os.environ.get(VISIBLE)
    if named is not None:
        return [name.strip() for name in named.split(",") if name.strip() not in ("", "-1")]
    for name in ("libcuda.so.1", "libcuda.so", "nvcuda.dll"):
        with contextlib.suppress(OSError):
            driver, count = ctypes.CDLL(name), ctypes.c_int(0)
            if driver.cuInit(0) == 0 and driver.cuDeviceGetCount(ctypes.byref(count)) == 0:
                return [str(k) for k in range(count.value)]
    return []
