"""Start Warp once, without output.

AEROKERNELS_WARP_FLAGS, if set, replaces Warp's compiler flags on the CPU. With "-march=native" alone kernels compile in
two thirds of the time, give the same bits, and run 15 to 45 % slower: useful if little is traced.
"""

import os
import sys
from collections.abc import Callable
from pathlib import Path

import warp as wp

from aerokernels.process.kernel_cache import remove_damaged, spare_cache, why_unusable

from .opened import OPENED


def start_warp() -> None:
    """Start Warp without its banner; raises NoCacheError where no folder takes the kernels that Warp builds."""
    OPENED.once("Warp", _start)


def open_device(name: str) -> wp.Device:
    """Start Warp, and return its device of this name after one thread has made its context and streams.

    Warp makes them when they are first asked for, without a lock: threads that ask at the same time each make their
    own, and destroy streams on which others have launched. Raises a ValueError if the device does not exist.
    """
    start_warp()
    device = wp.get_device(name)
    OPENED.once(("context", device.alias), lambda: device.context)
    return device


def _start() -> None:
    wp.config.quiet = True
    wp.config.log_level = wp.LOG_WARNING
    if flags := os.environ.get("AEROKERNELS_WARP_FLAGS"):
        wp.config.cpu_compiler_flags = flags
    try:
        _silently(wp.init)
        why = why_unusable(Path(wp.config.kernel_cache_dir))
    except OSError as error:
        why = f"Warp's kernel cache cannot be made ({error})"
    if why:
        wp.config.kernel_cache_dir = spare_cache("warp", why)
        _silently(wp.init)
    remove_damaged(Path(wp.config.kernel_cache_dir))


def _silently(call: Callable[[], None]) -> None:
    """Call a function with the output of native code to stderr suppressed."""
    try:
        spoken = os.dup(2)
    except OSError:  # stderr is closed: nothing can be heard
        call()
        return
    if sys.stderr is not None:
        sys.stderr.flush()
    silent = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(silent, 2)
        call()
    finally:
        os.dup2(spoken, 2)
        os.close(silent)
        os.close(spoken)
