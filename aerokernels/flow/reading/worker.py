"""A child process for readers that stand on libraries in C and C++.

Such a library may print and go on, call exit, or crash on a damaged file. In the child it harms nobody: its end becomes
an error that names the file. What it prints as an error is an error. The child lives on between files, since starting
it takes half a second; its memory is bounded.
"""

import atexit
import math
import os
import pickle
import subprocess
import sys
import threading
from pathlib import Path
from typing import IO, Any

from ...opened import OPENED
from .calling import read_here
from .dataset import Dataset, ReadError

# A damaged file may announce more than it holds: what the child may take goes by the size of the file, compressed data
# allowed for, and so does the time. Files that only list others may take as much as the machine can give.
MEMORY_SHARE = 0.8
LEAST_MEMORY, MEMORY_FOR_BYTE = 2.0e9, 200.0  # [bytes], and for each byte of the file
LEAST_TIME, TIME_FOR_BYTE = 20.0, 1e-6  # [s], and for each byte: a twentieth of what a slow disk reads
# A library that goes round in circles on a damaged file is ended by the time that it computes: a small file takes 2 s.
LEAST_COMPUTING = 6.0  # [s], and for each byte as above
LISTS = (".pvd", ".vtm", ".vtmb", ".pvti", ".pvtr", ".pvts", ".pvtu")
DAMAGED = "the file is damaged or of another format: write it again"


class _Child:
    """One child process and the pipes to it."""

    def __init__(self):
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
        self.process = subprocess.Popen(
            [sys.executable, "-m", f"{__package__}.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment,
        )

    def ask(self, request: Any, time_limit: float) -> Any:
        """Send a request and wait for the answer; EOFError where the child ends, or is ended, before it answers."""
        assert self.process.stdin is not None and self.process.stdout is not None
        watch = threading.Timer(time_limit, self.process.kill)
        watch.start()
        try:
            pickle.dump(request, self.process.stdin, protocol=5)
            self.process.stdin.flush()
            return pickle.load(self.process.stdout)
        except (BrokenPipeError, pickle.UnpicklingError) as fault:
            raise EOFError from fault
        finally:
            watch.cancel()

    def end(self) -> int:
        """End the child: its exit status, negative for a signal."""
        for pipe in (self.process.stdin, self.process.stdout):
            try:
                if pipe is not None:
                    pipe.close()
            except OSError:
                pass
        try:
            return self.process.wait(timeout=1.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()


def _idle() -> list[_Child]:
    """The children of this process that wait for a file to read."""
    children: list[_Child] = OPENED.once(("file readers", os.getpid()), list)
    return children


def in_child(module: str, path: Path, time, options: dict[str, Any]) -> Dataset:
    """Call the function `read` of a module of this package in the child.

    Raises:
        ReadError: What the reader raises, what its library prints as an error, and the child's end.
    """
    with OPENED.lock:
        idle = _idle()  # a forked process begins with none: the children, and the pipes to them, are its parent's
        used = idle.pop() if idle else None
        if used is not None and used.process.poll() is not None:
            used.end()
            used = None
    # What a library did to its memory with one damaged file may end it with the next: that one gets a child of its own.
    for child in (used, None) if used is not None else (None,):
        child = child or _Child()
        try:
            kind, answer = child.ask((module, str(path), time, options), time_limit(path))
            break
        except (EOFError, OSError):
            status = child.end()
        except BaseException:
            child.end()
            raise
    else:
        cause = f"signal {-status}" if status < 0 else f"status {status}"
        raise ReadError(path, f"the library that reads it ended with {cause}", DAMAGED)
    with OPENED.lock:
        idle.append(child)
    if kind == "error":
        raise ReadError.said(answer)
    assert isinstance(answer, Dataset)
    return answer


@atexit.register
def _end_idle() -> None:
    idle = _idle()
    while idle:
        idle.pop().end()


def time_limit(path: Path) -> float:
    """How long the child may take for a file [s]."""
    return 600.0 if path.suffix.lower() in LISTS else LEAST_TIME + TIME_FOR_BYTE * path.stat().st_size


def _limit(path: Path, inherited: float = 0.0) -> None:
    """Bound the memory that this process may take for a file, and how long it may compute.

    A forked process has `inherited` bytes of its parent's addresses, which are granted beside the file's.
    """
    try:
        import resource

        total = MEMORY_SHARE * os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        own = total
        if path.suffix.lower() not in LISTS:
            own = min(total, LEAST_MEMORY + MEMORY_FOR_BYTE * path.stat().st_size)
        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        resource.setrlimit(resource.RLIMIT_AS, (int(own + inherited), hard))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        used = resource.getrusage(resource.RUSAGE_SELF)
        allowed = LEAST_COMPUTING - LEAST_TIME + time_limit(path)
        hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(used.ru_utime + used.ru_stime + allowed), hard))
    except (ImportError, OSError, ValueError):  # not on this system
        pass


def _serve(requests: IO[bytes], answers: IO[bytes]) -> None:
    """Answer requests until there are no more."""
    while True:
        try:
            module, path, time, options = pickle.load(requests)
        except EOFError:
            return
        _limit(Path(path))
        try:
            answer: tuple[str, Any] = ("dataset", read_here(module, Path(path), time, options))
        except ReadError as fault:
            answer = ("error", str(fault))
        pickle.dump(answer, answers, protocol=5)
        answers.flush()


def _main() -> None:
    # Libraries print to the standard output: the answers go through a copy of it that they do not know.
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    _serve(sys.stdin.buffer, answers)


if __name__ == "__main__":
    _main()
