"""Cases given to the workers of a Dask client, and what came of each.

Dask gives the cases of a dead worker to another; a case at which several workers died has failed. A scheduler that is
lost ends the sweep: the cases that nobody has computed have not failed, and are computed when it goes on.
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

LOOK_EVERY = 1.0  # [s] at the client, while nothing is done
LONELY = 10.0  # [s] without an answer until it is asked whether there are workers at all
GONE = (
    "the Dask scheduler is gone, or its client was closed or restarted: what was kept in --out stays, and the same "
    "sweep goes on from there"
)
_one_at_a_time = threading.Lock()


def compute_alone(case: Case) -> dict[str, Any]:
    """Compute a case; a worker of many threads takes one at a time, since a case uses all the cores by itself."""
    from aerokernels.jobs.sweeps.case import compute

    with _one_at_a_time:
        return compute(case)


def run_dask(
    client: "Client", cases: Sequence[Case], given_up: Callable[[], bool]
) -> Iterator[tuple[int, dict[str, Any]]]:
    """Compute cases on a client's workers; yields the number and the outcome of each as it is done.

    Args:
        client: The client.
        cases: The cases.
        given_up: Whether no worker will come any more, where there is none.

    Raises:
        RuntimeError: The scheduler or the client is gone, or all workers are and no other will come.
    """
    # A name of this sweep alone: others may use the scheduler, from processes with the same number elsewhere.
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
            with contextlib.suppress(RuntimeError, OSError):  # it is lost just now
                client.cancel(list(futures), force=True)


def _next(done: "queue.SimpleQueue[Future]", client: "Client", given_up: Callable[[], bool]) -> "Future":
    """Wait for a case that is done; warn where there is no worker to do any.

    Raises:
        RuntimeError: As for `run_dask`.
    """
    waited, told = 0.0, False
    while True:
        with contextlib.suppress(queue.Empty):
            return done.get(timeout=LOOK_EVERY)
        if client.status not in ("running", "connecting"):
            raise RuntimeError(GONE)
        waited += LOOK_EVERY
        if waited < LONELY or client.status != "running":
            continue
        waited = 0.0
        with contextlib.suppress(OSError, CancelledError):  # lost just now: its status says so next
            if client.nthreads():
                told = False
            elif given_up():
                raise RuntimeError("all Dask workers of this machine have died, again and again: see to their memory")
            elif not told:
                told = True
                warnings.warn("the Dask scheduler has no workers: the sweep waits until there are some", stacklevel=2)


def _outcome(future: "Future", client: "Client") -> dict[str, Any]:
    """What a case that is done gave.

    Raises:
        RuntimeError: It was not computed, since the scheduler or the client is gone.
    """
    try:
        return future.result()
    except CancelledError:
        raise RuntimeError(GONE) from None
    except Exception as fault:
        if client.status != "running":
            raise RuntimeError(GONE) from None
        text = " ".join(str(fault).split())
        return {"error": f"its Dask worker failed: {type(fault).__name__}: {text}"}
