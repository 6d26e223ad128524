"""Starting Warp, and the devices it finds."""

import warp as wp

from ....quiet_warp import start_warp
from ..info import NO_CUDA, BackendInfo, warp_processor


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
