"""Make forks safe while another thread of the process works with the package.

A fork copies locks that another thread holds, but not that thread, so that the child would wait for them for ever.
While a first call imports its engine, opens a device or loads a kernel, it holds locks of Python's imports, of Warp and
of its compiler; that ends in seconds, and the fork waits for it. Up to Python 3.11 a thread that computes a cached
property holds a lock of all objects of its class: the child gets new ones, as it does of this package (opened.py).

Functions that run before a fork are called from the last registered to the first. Those of `logging` and
`concurrent.futures` take locks that an import may need: they are imported first, so that this module waits before them.
"""

import os
import sys
import threading
import time
from functools import cached_property
from pathlib import Path
from types import FrameType

from aerokernels.process.opened import OPENED

PATIENCE, PAUSE = 60.0, 0.01  # [s]; a thread that takes longer may itself wait for the one that forks

_PACKAGE = __name__.partition(".")[0]
_FOLDER = str(Path(__file__).parents[1]) + os.sep
_IMPORTS = "<frozen importlib._bootstrap>"
_LOADS = ("load", "get_kernel_hooks")  # functions of Warp that hold locks: its own, and those of its compiler
# Modules whose functions run as long as something is opened, or a kernel's source is made.
_ONCE = tuple(f"{_PACKAGE}.{name}" for name in ("process.opened", "tracing.engines.warp.library"))


def make_forks_safe() -> None:
    """Do so for this process, from the first call on: a program that only imports the package is left alone."""
    OPENED.once("safe forks", _register)


def _register() -> bool:
    import logging  # noqa: F401

    if hasattr(os, "register_at_fork"):  # not on Windows, which has no fork
        os.register_at_fork(before=_wait, after_in_child=_renew_properties)
    return True


def _wait() -> None:
    """Wait until no other thread holds a lock that it gives back soon."""
    own, end = threading.get_ident(), time.monotonic() + PATIENCE
    if _holds_locks(sys._getframe()):  # the others may wait for this thread
        return
    while time.monotonic() < end:
        if not any(_holds_locks(frame) for thread, frame in sys._current_frames().items() if thread != own):
            return
        time.sleep(PAUSE)


def _holds_locks(frame: FrameType | None) -> bool:
    """Return whether a thread, by its innermost frame, imports something for this package, or opens or loads it."""
    is_import = False
    while frame is not None:
        file, module = frame.f_code.co_filename, str(frame.f_globals.get("__name__"))
        is_import = is_import or file == _IMPORTS
        if (is_import and file.startswith(_FOLDER)) or module in _ONCE:
            return True
        if module.startswith("warp.") and frame.f_code.co_name in _LOADS:
            return True
        frame = frame.f_back
    return False


def _renew_properties() -> None:
    """Give the cached properties of this package new locks, where Python has such locks."""
    if sys.version_info >= (3, 12):
        return
    modules = [module for name, module in sys.modules.items() if name.partition(".")[0] == _PACKAGE]
    for owner in [each for module in modules for each in vars(module).values() if isinstance(each, type)]:
        for each in vars(owner).values():
            if isinstance(each, cached_property):
                each.lock = threading.RLock()  # type: ignore[attr-defined]
