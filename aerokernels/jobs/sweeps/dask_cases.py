"""Compute the cases of a sweep on the workers of a Dask client.

Dask moves the cases of a dead worker to another; a case at which several workers died has failed. Losing the scheduler
ends the sweep; cases not computed by then have not failed and are computed when the sweep is resumed.
"""

import contextlib
import queue
import threading
import uuid
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from typing import TYPE_CHECKING, Any

from aerokernels.jobs.sweeps.case import Case

if TYPE_CHECKING:
    from distributed import Client, Future

POLL_INTERVAL = 1.0  # [s] between checks of the client while no case is finished
COUNT_WORKERS_AFTER = 10.0  # [s] without a finished case until the number of workers is checked
SCHEDULER_LOST = (
    "the Dask scheduler is gone, or its client was closed or restarted: the finished cases are safe, and "
    "the same sweep resumes from there"
)
_one_at_a_time = threading.Lock()


def compute_alone(case: Case) -> dict[str, Any]:
    """Compute a case; a worker with several threads computes one case at a time, since a case uses all cores."""
    from aerokernels.jobs.sweeps.case import compute

    with _one_at_a_time:
        return compute(case)


def run_dask(
    client: "Client", cases: Sequence[Case], given_up: Callable[[], bool]
) -> Iterator[tuple[int, dict[str, Any]]]:
    """Compute cases on a client's workers; yield the number and the outcome of each case when it is finished.

    Args:
        client: The client.
        cases: The cases.
        given_up: Returns whether, if there are no workers, none will be started any more.

    Raises:
        RuntimeError: The scheduler or the client is lost, or all workers are and none will be started.
    """
    # A name unique to this sweep: others may use the scheduler from machines where process numbers repeat.
    name = f"aerokernels-{uuid.uuid4().hex}"
    futures = {client.submit(compute_alone, case, pure=False, key=f"{name}-{case.number}"): case for case in cases}
    done: queue.SimpleQueue[Future] = queue.SimpleQueue()
    for future in futures:
        future.add_done_callback(done.put)
    try:
        while futures:
            future = _next(done, client, given_up)
            outcome = _outcome(future, client)
            yield futures.pop(future).number, outcome
            future.release()
    finally:
        if futures and client.status == "running":
            with contextlib.suppress(RuntimeError, OSError):  # the client may be lost at this moment
                client.cancel(list(futures), force=True)


def _next(done: "queue.SimpleQueue[Future]", client: "Client", given_up: Callable[[], bool]) -> "Future":
    """Wait for the next finished case; warn if there are no workers.

    Raises:
        RuntimeError: See `run_dask`.
    """
    waited, warned = 0.0, False
    while True:
        with contextlib.suppress(queue.Empty):
            return done.get(timeout=POLL_INTERVAL)
        if client.status not in ("running", "connecting"):
            raise RuntimeError(SCHEDULER_LOST)
        waited += POLL_INTERVAL
        if waited < COUNT_WORKERS_AFTER or client.status != "running":
            continue
        waited = 0.0
        with contextlib.suppress(OSError, CancelledError):  # the client is lost; the next check of its status tells
            if client.nthreads():
                warned = False
            elif given_up():
                raise RuntimeError("all Dask workers of this machine have died several times: check the free memory")
            elif not warned:
                warned = True
                warnings.warn("the Dask scheduler has no workers: the sweep waits until there are some", stacklevel=2)


def _outcome(future: "Future", client: "Client") -> dict[str, Any]:
    """Return the outcome of a finished case.

    Raises:
        RuntimeError: The case was not computed because the scheduler or the client is lost.
    """
    try:
        return future.result()
    except CancelledError:
        raise RuntimeError(SCHEDULER_LOST) from None
    except Exception as fault:
        if client.status != "running":
            raise RuntimeError(SCHEDULER_LOST) from None
        text = " ".join(str(fault).split())
        return {"error": f"its Dask worker failed: {type(fault).__name__}: {text}"}
