"""Start Warp once, without output.

AEROKERNELS_WARP_FLAGS, if set, replaces Warp's compiler flags on the CPU. With "-march=native" alone kernels compile in
two thirds of the time, give the same bits, and run 15 to 45 % slower: useful if little is traced.
"""

import os
import sys
from collections.abc import Callable
from pathlib import Path

import warp as wp

from .opened import OPENED
from .spare_cache import NoCacheError, spare_cache, temporary_folder, why_misread, why_untrusted, why_unusable
from .warp_cache import lend_modules, remove_damaged

FLAGS = "AEROKERNELS_WARP_FLAGS"


def start_warp() -> None:
    """Start Warp without its banner, and without its warning about a missing CUDA driver.

    Raises:
        NoCacheError: No folder takes the kernels that Warp builds.
    """
    OPENED.once("Warp", _start)


def open_device(name: str) -> wp.Device:
    """Start Warp, and return its device of this name after one thread has made its context and streams.

    Warp makes them when they are first asked for, without a lock: threads that ask at the same time each make their
    own, and destroy streams on which others have launched.

    Raises:
        NoCacheError: As `start_warp`.
        ValueError: The device does not exist.
    """
    start_warp()
    device = wp.get_device(name)
    OPENED.once(("context", device.alias), lambda: device.context)
    return device


def _start() -> None:
    wp.config.quiet = True
    wp.config.log_level = wp.LOG_WARNING
    if os.environ.get(FLAGS):
        wp.config.cpu_compiler_flags = os.environ[FLAGS]
    usual = None
    try:
        _silently(wp.init)
        usual = Path(wp.config.kernel_cache_dir)
        why = why_unusable(usual) or why_untrusted(usual) or why_misread(usual)
    except OSError as error:
        why = f"Warp's kernel cache cannot be made ({error})"
    place = _spare(why, usual) if why else str(usual)
    folder = temporary_folder()
    if place and (folder is None or why_unusable(folder) or why_misread(folder)):
        wp.config.use_precompiled_headers = False  # Warp keeps them there; without, a module has another name
    if why and place:
        wp.config.kernel_cache_dir = place
        _silently(wp.init)
        if usual is not None:
            lend_modules(usual, Path(place))
    remove_damaged(Path(wp.config.kernel_cache_dir))


def _spare(why: str, usual: Path | None) -> str:
    """Return a folder for the kernels; "" if there is none, but the usual folder holds some and only takes no more."""
    try:
        return spare_cache("warp", why)
    except NoCacheError:
        if usual is None or os.access(usual, os.W_OK):
            raise
        return ""


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
