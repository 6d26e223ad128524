"""Run readers that depend on crash-prone libraries in a child process: a damaged file cannot end the calling process.

On a damaged file a library in C or C++ may print and go on, call exit, crash, exhaust the memory or compute for ever.
In the child this does no harm: the child's end becomes an error that names the file. The child stays alive between
files, because starting it takes as long as reading many files. Its limits of memory and time depend on the file's size.
"""

import atexit
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

from aerokernels.process.foreign_files import LISTS, FileFault, check_own_files
from aerokernels.process.machine import address_space, host_memory, python_child
from aerokernels.process.opened import OPENED

LISTED_TIME = 600.0  # [s] for files that only list other files
LEAST_COMPUTING = 6.0  # [s] of computing for any other file; a small one takes 2 s
# Readers need no linear algebra, whose threads would each take address space: on many cores more than the limit.
ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
DAMAGED = "the file is damaged or of another format: write it again"


class LibraryEndedError(FileFault):
    """The library that reads a file ended its process, or exceeded its limits; the message names the file."""


class Bounds(NamedTuple):
    """Limits of the child for a file: memory [bytes], computing time [s], and total time [s]."""

    memory: float
    computing: float
    time: float


def bounds_of(path: Path) -> Bounds:
    """Return the limits for a file, proportional to its size: a damaged one may announce more than it holds.

    There is room for compressed data and for a twentieth of a slow disk's speed. Files that only list other files may
    use most of the machine's memory. The computing time ends a library in an endless loop.
    """
    total = 0.8 * host_memory()
    if path.suffix.lower() in LISTS:
        return Bounds(total, LISTED_TIME, LISTED_TIME)
    size = path.stat().st_size
    return Bounds(min(total, 2.0e9 + 200.0 * size), LEAST_COMPUTING + 1e-6 * size, 60.0 + 1e-6 * size)


class _Child:
    """One child process and the pipes to it."""

    def __init__(self):
        self.is_late = False  # whether it was ended because it did not answer in time
        self.process = subprocess.Popen(
            **python_child(["-m", __name__], ONE_THREAD),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )

    def ask(self, request: Any, time_limit: float) -> Any:
        """Send a request and return the answer; raises EOFError if the child ends, or is ended, before it answers."""
        assert self.process.stdin is not None and self.process.stdout is not None

        def end() -> None:
            self.is_late = True
            self.process.kill()

        timer = threading.Timer(time_limit, end)
        timer.daemon = True
        timer.start()
        try:
            pickle.dump(request, self.process.stdin, protocol=5)
            self.process.stdin.flush()
            return pickle.load(self.process.stdout)
        except (BrokenPipeError, pickle.UnpicklingError) as fault:
            raise EOFError from fault
        finally:
            timer.cancel()

    def end(self) -> int:
        """End the child, and return its exit status, negative for a signal."""
        for pipe in filter(None, (self.process.stdin, self.process.stdout)):
            with suppress(OSError):
                pipe.close()
        try:
            return self.process.wait(timeout=1.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()


def _idle() -> list[_Child]:
    """Return the children of this process that wait for a file to read."""
    children: list[_Child] = OPENED.once(("file readers", os.getpid()), list)
    return children


def in_child(path: Path, function: str, *arguments: Any) -> Any:
    """Call a function of this package, "package.module:name", in the child, within the limits for the file it reads.

    Arguments and the returned value are pickled. Raises a LibraryEndedError where the child ends or exceeds its
    limits, an OwnFilesError where the file names others that it may not, and any exception of the function.
    """
    bounds, folder = bounds_of(path), os.sep
    with suppress(OSError):  # the working directory is gone
        folder = os.getcwd()
    with OPENED.lock:
        idle = _idle()  # empty in a forked process: the parent's children stay the parent's
        used = idle.pop() if idle else None
        if used is not None and used.process.poll() is not None:
            used.end()
            used = None
    # A damaged file may corrupt a library's memory and end the child at the next file: try that file in a new child.
    for child in (used, None) if used is not None else (None,):
        child = child or _Child()
        try:
            raised, answer = child.ask((folder, path, bounds, function, arguments), bounds.time)
            break
        except (EOFError, OSError):
            status = child.end()
        except BaseException:
            child.end()
            raise
    else:
        assert child is not None  # one was made above
        if child.is_late:
            why = "the machine or its disk is busy, or the file is damaged"
            raise LibraryEndedError(f"{path}: it was not read within {bounds.time:.0f} s: {why}: try again")
        cause = f"signal {-status}" if status < 0 else f"status {status}"
        raise LibraryEndedError(f"{path}: the library that reads it ended with {cause}: {DAMAGED}")
    if raised:
        child.end()  # half-opened objects keep the file open, and HDF5 a lock on it: nobody could write it again
        raise answer
    with OPENED.lock:
        idle.append(child)
    return answer


@atexit.register
def _end_idle() -> None:
    idle = _idle()
    while idle:
        idle.pop().end()


def limit(bounds: Bounds, inherited: float = 0.0) -> None:
    """Limit this process's memory, beyond `inherited` bytes in use before the first file, and its computing time."""
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
    inherited = address_space()
    while True:
        try:
            folder, path, bounds, function, arguments = pickle.load(requests)
        except EOFError:
            return
        with suppress(OSError):
            os.chdir(folder)  # paths may be relative, and the caller may have changed it since the child was started
        limit(bounds, inherited)
        try:
            check_own_files(path)
            module, _, name = function.partition(":")
            raised, answer = False, getattr(import_module(module), name)(*arguments)
        except Exception as fault:
            raised, answer = True, _sent(fault)
        pickle.dump((raised, answer), answers, protocol=5)
        answers.flush()


def _sent(fault: Exception) -> Any:
    """Return the exception, or one with the same text if it cannot be pickled."""
    try:
        return pickle.loads(pickle.dumps(fault))  # without the frames, which refer to open files
    except Exception:
        return RuntimeError(f"{type(fault).__name__}: {fault}")


if __name__ == "__main__":
    # Libraries print to the standard output, so the answers go through a private copy of it.
    private = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    _serve(sys.stdin.buffer, private)
