"""Start Warp, and list its devices."""

import warp as wp

from ....process.quiet_warp import start_warp
from ..info import NO_CUDA, BackendInfo, warp_processor


def list_devices(memory: bool = False) -> list[BackendInfo]:
    """Return Warp's devices, CUDA devices first; with `memory`, including the memory of each."""
    start_warp()
    version, found = wp.__version__, []
    for device in wp.get_devices():
        if device.is_cuda:
            size, reason = device.total_memory if memory else None, "a GPU is preferred"
            found.append(BackendInfo("warp", device.alias, device.name, version, True, True, size, reason))
        else:
            reason = "a GPU is preferred" if wp.is_cuda_available() else NO_CUDA
            found.append(warp_processor(version, reason, memory))
    return sorted(found, key=lambda info: info.device == "cpu")
