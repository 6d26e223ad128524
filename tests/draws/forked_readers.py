"""Fork readers of fragile files from this process, which has imported their libraries: milliseconds instead of 1 s.

For reading random files by the thousand; bounds and answers are those of aerokernels/process/fragile.py.
"""

import gc
import os
import signal
import time
from pathlib import Path

from aerokernels.process import fragile

COMPUTING = 1.0  # [s], as `fragile.LEAST_COMPUTING`: a forked reader has nothing to import


class _Process:
    """A forked reader, with the part of the interface of `subprocess.Popen` that `fragile` uses."""

    def __init__(self) -> None:
        asked, asks = os.pipe()
        answered, answers = os.pipe()
        self.status: int | None = None
        self.pid = os.fork()
        if not self.pid:
            os.close(asks)
            os.close(answered)
            _serve(asked, answers)
        os.close(asked)
        os.close(answers)
        self.stdin, self.stdout = os.fdopen(asks, "wb"), os.fdopen(answered, "rb")

    def poll(self) -> int | None:
        """The status once the process has ended, as in `subprocess`."""
        if self.status is None:
            ended, status = os.waitpid(self.pid, os.WNOHANG)
            self.status = os.waitstatus_to_exitcode(status) if ended else None
        return self.status

    def kill(self) -> None:
        """End it."""
        if self.status is None:
            os.kill(self.pid, signal.SIGKILL)

    def wait(self, timeout: float = float("inf")) -> int:
        """Wait for the process and return its status; kill it after `timeout` seconds."""
        end = time.monotonic() + timeout
        while (status := self.poll()) is None:
            if time.monotonic() > end:
                self.kill()
            time.sleep(0.0005)
        return status


class _Forked(fragile._Child):
    """One forked child and the pipes to it."""

    def __init__(self) -> None:
        self.is_late = False
        self.process = _Process()  # type: ignore[assignment]


def addresses() -> float:
    """Size of this process's address space [bytes]; 0 where the system does not report it."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0.0


def fork_readers() -> None:
    """Make `fragile` fork its children from now on. Needs `fork`."""
    vars(fragile)["_Child"] = _Forked
    vars(fragile)["LEAST_COMPUTING"] = COMPUTING


def _serve(asked: int, answers: int) -> None:
    """Run the child's loop; never returns."""
    null = os.open(os.devnull, os.O_RDWR)
    os.dup2(null, 1)
    os.dup2(null, 2)
    gc.freeze()  # `fragile` collects garbage after each damaged file: exclude the objects inherited from the parent
    try:
        fragile._serve(os.fdopen(asked, "rb"), os.fdopen(answers, "wb"))
        os._exit(0)
    except BaseException:
        os._exit(1)
