"""Compute the cases of a sweep on worker processes of this machine.

A worker takes cases of the same index field as long as there are any. A worker that dies is replaced, and its case is
started again; a case at which two workers died has failed.
"""

import contextlib
import socket
import subprocess
import tempfile
from collections import deque
from collections.abc import Iterator, Sequence
from multiprocessing.connection import Connection, wait
from typing import IO, Any

from aerokernels.jobs.sweeps.case import Case
from aerokernels.process.machine import python_child

ATTEMPTS = 2  # deaths of workers at which a case fails, or, per worker, at which starting workers is given up


class Worker:
    """A worker process and its current case.

    Attributes:
        pipe: The connection to the process.
        environment: Variables added to this process's environment.
        ready: Whether the worker has reported that it is ready.
        case: The case that it computes; None if idle.
    """

    def __init__(self, environment: dict[str, str]):
        """Start the process."""
        self.environment, self.ready, self.case = environment, False, None
        self._errors: IO[bytes] = tempfile.TemporaryFile()
        near, far = socket.socketpair()
        self.process = subprocess.Popen(
            **python_child(["-m", "aerokernels.jobs.sweeps.worker", str(far.fileno())], environment),
            pass_fds=[far.fileno()],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=self._errors,
        )
        far.close()
        self.pipe = Connection(near.detach())

    case: Case | None

    def end(self) -> str:
        """End the process; return its exit status or signal and its last line on stderr."""
        self.pipe.close()
        if self.process.poll() is None:
            self.process.terminate()
        try:
            status = self.process.wait(timeout=5.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            status = self.process.wait()
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="replace").split("\n")
        self._errors.close()
        last = next((line.strip() for line in reversed(lines) if line.strip()), "")
        described = f"signal {-status}" if status < 0 else f"exit status {status}"
        return f"{described}, {last}" if last else described


def run_local(cases: Sequence[Case], environments: Sequence[dict[str, str]]) -> Iterator[tuple[int, dict[str, Any]]]:
    """Compute cases; yield the number and the outcome of each case when it is finished.

    Args:
        cases: The cases, ordered by group.
        environments: Variables to add to the environment of each worker.

    Raises:
        RuntimeError: Workers die before they are ready.
    """
    queue = Queue(cases)
    deaths: dict[int, int] = {}
    failed_starts = 0
    with contextlib.ExitStack() as ending:
        workers = [Worker(environment) for environment in environments]
        ending.callback(lambda: [worker.end() for worker in workers])
        while queue.waiting or any(worker.case for worker in workers):
            for pipe in wait([worker.pipe for worker in workers]):
                worker = next(one for one in workers if one.pipe is pipe)
                try:
                    answer = worker.pipe.recv()
                except (EOFError, OSError):
                    case, how = worker.case, worker.end()
                    workers.remove(worker)
                    failed_starts = 0 if worker.ready else failed_starts + 1
                    if failed_starts >= ATTEMPTS * len(environments):
                        raise RuntimeError(f"worker processes die as they start: {how}") from None
                    if case is not None:
                        deaths[case.number] = deaths.get(case.number, 0) + 1
                        if deaths[case.number] < ATTEMPTS:
                            queue.put_back(case)
                        else:
                            yield case.number, {"error": f"its worker process died, {ATTEMPTS} times: {how}"}
                    if queue.waiting:
                        workers.append(Worker(worker.environment))
                    continue
                done, worker.case, worker.ready = worker.case, None, True
                following = queue.take(done.group if done else None)
                if following is not None:
                    worker.case = following
                    with contextlib.suppress(BrokenPipeError, OSError):  # the worker died; the next receive shows it
                        worker.pipe.send(following)
                if done is not None:
                    yield done.number, answer


class Queue:
    """Waiting cases, by group."""

    def __init__(self, cases: Sequence[Case]):
        """Sort the cases by group."""
        self._groups: dict[str, deque[Case]] = {}
        self._users: dict[str, int] = {}
        for case in cases:
            self._groups.setdefault(case.group, deque()).append(case)

    @property
    def waiting(self) -> bool:
        """Whether any case waits."""
        return bool(self._groups)

    def take(self, group: str | None) -> Case | None:
        """Take the next case of a group, or, if it has none, of the group with the most cases per worker."""
        if not self._groups:
            return None
        if group not in self._groups:
            if group is not None:
                self._users[group] = self._users.get(group, 1) - 1
            group = max(self._groups, key=lambda name: len(self._groups[name]) / (1 + self._users.get(name, 0)))
            self._users[group] = self._users.get(group, 0) + 1
        assert group is not None
        case = self._groups[group].popleft()
        if not self._groups[group]:
            del self._groups[group]
        return case

    def put_back(self, case: Case) -> None:
        """Return a case to the front of its group, to be computed again."""
        self._groups.setdefault(case.group, deque()).appendleft(case)
