"""Starting Warp, once and without a word."""

import functools
import os
import sys

import warp as wp


@functools.cache
def start_warp() -> None:
    """Start Warp without its banner; a missing CUDA driver is no news on a machine without a GPU."""
    wp.config.quiet = True
    wp.config.log_level = wp.LOG_WARNING
    sys.stderr.flush()
    silent, spoken = os.open(os.devnull, os.O_WRONLY), os.dup(2)
    try:
        os.dup2(silent, 2)  # the warning is printed by native code, past any Python stream
        wp.init()
    finally:
        os.dup2(spoken, 2)
        os.close(silent)
        os.close(spoken)
