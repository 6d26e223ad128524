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
from .spare_cache import spare_cache
from .warp_cache import remove_damaged

FLAGS = "AEROKERNELS_WARP_FLAGS"


def start_warp() -> None:
    """Start Warp without its banner, and without its warning about a missing CUDA driver."""
    OPENED.once("Warp", _start)


def _start() -> None:
    wp.config.quiet = True
    wp.config.log_level = wp.LOG_WARNING
    if os.environ.get(FLAGS):
        wp.config.cpu_compiler_flags = os.environ[FLAGS]
    try:
        _silently(wp.init)
    except OSError as error:  # Warp's kernel cache folder cannot be made
        wp.config.kernel_cache_dir = spare_cache("warp", f"Warp's kernel cache cannot be made ({error})")
        _silently(wp.init)
    remove_damaged(Path(wp.config.kernel_cache_dir))


def _silently(call: Callable[[], None]) -> None:
    """Call a function with the output of native code to stderr suppressed."""
    sys.stderr.flush()
    silent, spoken = os.open(os.devnull, os.O_WRONLY), os.dup(2)
    try:
        os.dup2(silent, 2)
        call()
    finally:
        os.dup2(spoken, 2)
        os.close(silent)
        os.close(spoken)
