"""Starting Warp, and the devices it finds."""

import functools
import os
import sys

import warp as wp

from .backend_info import BackendInfo, host_memory


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


def thread_count() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)


def list_devices() -> list[BackendInfo]:
    """Warp's devices, a CUDA device first where there is one."""
    start_warp()
    found = []
    for device in wp.get_devices():
        if device.is_cuda:
            text, memory, reason = device.name, device.total_memory, "a GPU is taken where there is one"
        else:
            text = f"{thread_count()} cores, launches chunked over threads"
            memory, reason = host_memory(), ("a GPU goes before it" if wp.is_cuda_available() else "no CUDA device")
        found.append(BackendInfo("warp", device.alias, text, wp.__version__, True, True, memory, reason))
    return sorted(found, key=lambda info: info.device == "cpu")
