"""Functions that stand on fragile libraries, called in a child process: a damaged file cannot harm this one.

A library in C or C++ may print and go on, call exit, crash, eat the memory or compute for ever on a damaged file. In
the child it harms nobody: its end becomes an error that names the file. The child lives on between files, since
starting it takes as long as reading many; what it may take of memory and time goes by the size of the file.
"""

import atexit
import gc
import math
import os
import pickle
import subprocess
import sys
import threading
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import IO, Any, NamedTuple

from .machine import child_environment, host_memory
from .opened import OPENED

# A damaged file may announce more than it holds: what the child may take goes by the size of the file, compressed data
# allowed for, and so does the time. Files that only list others may take as much as the machine can give.
MEMORY_SHARE = 0.8
LEAST_MEMORY, MEMORY_FOR_BYTE = 2.0e9, 200.0  # [bytes], and for each byte of the file
LEAST_TIME, TIME_FOR_BYTE = 20.0, 1e-6  # [s], and for each byte: a twentieth of what a slow disk reads
# A library that goes round in circles on a damaged file is ended by the time that it computes: a small file takes 2 s.
LEAST_COMPUTING = 6.0  # [s], and for each byte as above
LISTS, TIME_FOR_LISTS = (".pvd", ".series", ".vtm", ".vtmb", ".pvti", ".pvtr", ".pvts", ".pvtu"), 600.0  # [s]
DAMAGED = "the file is damaged or of another format: write it again"


class LibraryEndedError(ValueError):
    """The library that reads a file ended its process, or was ended by the bounds on it; names the file."""


class Bounds(NamedTuple):
    """What the child may take for a file: memory [bytes], time that it computes [s], and time in all [s]."""

    memory: float
    computing: float
    time: float


def bounds_of(path: Path) -> Bounds:
    """The bounds for a file; where the system does not tell its memory, that is not bounded."""
    total = MEMORY_SHARE * host_memory()
    if path.suffix.lower() in LISTS:
        return Bounds(total, LEAST_COMPUTING - LEAST_TIME + TIME_FOR_LISTS, TIME_FOR_LISTS)
    size = path.stat().st_size
    more = TIME_FOR_BYTE * size
    return Bounds(min(total, LEAST_MEMORY + MEMORY_FOR_BYTE * size), LEAST_COMPUTING + more, LEAST_TIME + more)


class _Child:
    """One child process and the pipes to it."""

    def __init__(self):
        self.process = subprocess.Popen(
            [sys.executable, "-m", __name__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=child_environment(),
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
        for pipe in filter(None, (self.process.stdin, self.process.stdout)):
            with suppress(OSError):
                pipe.close()
        try:
            return self.process.wait(timeout=1.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()


def _idle() -> list[_Child]:
    """The children of this process that wait for a file to read."""
    children: list[_Child] = OPENED.once(("file readers", os.getpid()), list)
    return children


def in_child(path: Path, function: str, *arguments: Any) -> Any:
    """Call a function of this package in the child.

    Args:
        path: The file that it reads: by its size the child is bounded, and messages name it.
        function: "package.module:name".
        arguments: What it is called with; they and what it returns are pickled.

    Raises:
        LibraryEndedError: The child ended, or was ended by its bounds.
        Exception: Whatever the function raises.
    """
    bounds = bounds_of(path)
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
            raised, answer, open_still = child.ask((path, bounds, function, arguments), bounds.time)
            break
        except (EOFError, OSError):
            status = child.end()
        except BaseException:
            child.end()
            raise
    else:
        cause = f"signal {-status}" if status < 0 else f"status {status}"
        raise LibraryEndedError(f"{path}: the library that reads it ended with {cause}: {DAMAGED}")
    if open_still:  # HDF5 holds a lock on it, and nobody could write it again
        child.end()
    else:
        with OPENED.lock:
            idle.append(child)
    if raised:
        raise answer
    return answer


@atexit.register
def _end_idle() -> None:
    idle = _idle()
    while idle:
        idle.pop().end()


def limit(bounds: Bounds, inherited: float = 0.0) -> None:
    """Bound the memory that this process may take, and how much longer it may compute.

    A forked process has `inherited` bytes of its parent's addresses, which are granted beside the file's.
    """
    try:
        import resource

        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        if math.isfinite(bounds.memory):
            resource.setrlimit(resource.RLIMIT_AS, (int(bounds.memory + inherited), hard))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        used = resource.getrusage(resource.RUSAGE_SELF)
        hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(used.ru_utime + used.ru_stime + bounds.computing), hard))
    except (ImportError, OSError, ValueError):  # not on this system
        pass


def _serve(requests: IO[bytes], answers: IO[bytes]) -> None:
    """Answer requests until there are no more."""
    while True:
        try:
            path, bounds, function, arguments = pickle.load(requests)
        except EOFError:
            return
        limit(bounds)
        try:
            module, _, name = function.partition(":")
            raised, answer = False, getattr(import_module(module), name)(*arguments)
        except Exception as fault:
            raised, answer = True, _sent(fault)
        if raised:
            gc.collect()  # what was half opened keeps its file until it goes
        pickle.dump((raised, answer, _has_open(path)), answers, protocol=5)
        answers.flush()


def _has_open(path: Path) -> bool:
    """Whether this process has a file open, where the system tells."""
    with suppress(OSError):
        own = os.stat(path)
        for name in os.listdir("/proc/self/fd"):
            with suppress(OSError):
                if os.path.samestat(own, os.stat(f"/proc/self/fd/{name}")):
                    return True
    return False


def _sent(fault: Exception) -> Any:
    """The fault, or one of the same words where it cannot be pickled."""
    try:
        return pickle.loads(pickle.dumps(fault))  # without the frames, which hold what was opened
    except Exception:
        return RuntimeError(f"{type(fault).__name__}: {fault}")


def _main() -> None:
    # Libraries print to the standard output: the answers go through a copy of it that they do not know.
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    _serve(sys.stdin.buffer, answers)


if __name__ == "__main__":
    _main()
