"""Starting Warp, and the devices it finds."""

import functools
import os
import sys

import warp as wp

from ..info import NO_CUDA, BackendInfo, warp_processor


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


def list_devices() -> list[BackendInfo]:
    """Warp's devices, a CUDA device first where there is one."""
    start_warp()
    version, found = wp.__version__, []
    for device in wp.get_devices():
        if device.is_cuda:
            reason, memory = "a GPU is taken where there is one", device.total_memory
            found.append(BackendInfo("warp", device.alias, device.name, version, True, True, memory, reason))
        else:
            reason = "a GPU goes before it" if wp.is_cuda_available() else NO_CUDA
            found.append(warp_processor(version, reason))
    return sorted(found, key=lambda info: info.device == "cpu")
