"""Determine the cores and memory that container, batch job or shell grant this process, and set up child processes."""

import math
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from aerokernels.process.opened import OPENED

GROUPS = Path("/sys/fs/cgroup")
MEMBERSHIP = Path("/proc/self/cgroup")


def core_count() -> int:
    """Number of cores that this process may use: those it is bound to, or its control group's share of time."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)
    quota = OPENED.once("quota of cores", lambda: min(_core_quotas(), default=math.inf))
    return cores if quota >= cores else max(1, math.ceil(quota))


@contextmanager
def patient_threads() -> Iterator[None]:
    """Start threads in this block, including those of libraries, that take no core from the thread that wakes them.

    Linux may give a woken thread the core of the thread that woke it, which here may hold Python's lock. Threads of the
    scheduling class SCHED_BATCH wait for a free core instead, with the same share of time.
    """
    is_usual = hasattr(os, "sched_setscheduler") and os.sched_getscheduler(0) == os.SCHED_OTHER
    try:
        if is_usual:
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    except OSError:  # a container may forbid it
        is_usual = False
    try:
        yield
    finally:
        if is_usual:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def host_memory() -> float:
    """Memory that this process may use [bytes] if no other process needs it; infinite if the system gives no limit."""
    try:
        whole = float(os.sysconf("SC_PAGE_SIZE")) * os.sysconf("SC_PHYS_PAGES")
    except (ValueError, OSError, AttributeError):  # not on this system
        whole = math.inf
    return min([whole, _address_space()[0], *(limit for limit, _ in _group_memory())])


def free_memory() -> float:
    """Memory available without ending other processes [bytes]; infinite if the system does not report it."""
    limit, used = _address_space()
    free = [limit - used, *(limit - used for limit, used in _group_memory())]
    return max(0.0, min(_available(), *free))


def python_child(arguments: Sequence[str], own: Mapping[str, str] | None = None) -> dict[str, Any]:
    """Return `args` and `env` of a child Python process, with this process's environment, `own` and `sys.path`.

    `-P` keeps the working directory off the child's path: a `random.py` beside somebody's flow file is not imported.
    """
    paths = dict.fromkeys([*filter(None, sys.path), str(Path(__file__).resolve().parents[2])])
    environment = {**os.environ, **(own or {}), "PYTHONPATH": os.pathsep.join(paths)}
    return {"args": [sys.executable, "-P", *arguments], "env": environment}


def _available() -> float:
    kilobytes = _listed(Path("/proc/meminfo"), "MemAvailable:")
    return host_memory() if math.isnan(kilobytes) else 1024.0 * kilobytes


def address_space() -> float:
    """Return the address space that this process uses [bytes]; 0 if the system does not tell."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        return float(pages) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, IndexError):
        return 0.0


def _address_space() -> tuple[float, float]:
    """Return the limit of the process's address space (ulimit -v), and the address space in use [bytes]."""
    try:
        import resource

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    except (ImportError, OSError, ValueError):
        return math.inf, 0.0
    return (math.inf, 0.0) if limit == resource.RLIM_INFINITY else (float(limit), address_space())


def _folders() -> Iterator[Path]:
    """Return the folders of this process's control group (version 2), and of its parents, that may limit a resource.

    In a container the path may be the host's; then only the group at the root is visible.
    """
    try:
        lines = MEMBERSHIP.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return
    for line in lines:
        _, names, path = [*line.split(":", 2), "", ""][:3]
        own = GROUPS / path.lstrip("/")
        if not names:
            yield from (folder for folder in (own, *own.parents) if folder == GROUPS or GROUPS in folder.parents)


def _number(folder: Path, name: str, field: int = 0) -> float:
    """Return a number in a control group's file; NaN if there is none, infinite for "max"."""
    try:
        word = (folder / name).read_text(encoding="ascii").split()[field]
        return math.inf if word == "max" else float(word)
    except (OSError, ValueError, IndexError):
        return math.nan


def _core_quotas() -> Iterator[float]:
    for folder in _folders():
        quota, period = _number(folder, "cpu.max"), _number(folder, "cpu.max", 1)
        if 0.0 < quota < math.inf and period > 0.0:
            yield quota / period


def _group_memory() -> Iterator[tuple[float, float]]:
    """Yield each control group's memory limit and its memory in use, without droppable file caches [bytes]."""
    for folder in _folders():
        limit, used = _number(folder, "memory.max"), _number(folder, "memory.current")
        if 0.0 < limit < math.inf and used >= 0.0:
            caches = _listed(folder / "memory.stat", "inactive_file")
            yield limit, max(0.0, used - (0.0 if math.isnan(caches) else caches))


def _listed(path: Path, name: str) -> float:
    """Return a number of a file with a name and a number on each line; NaN if it is not there."""
    try:
        lines = [line.split() for line in path.read_text(encoding="ascii").splitlines()]
        return next((float(line[1]) for line in lines if line[0] == name), math.nan)
    except (OSError, ValueError, IndexError):
        return math.nan
