"""The description of a backend on a device, and cheap checks for what this machine has."""

import ctypes
import math
import sys
from dataclasses import dataclass

from ...process.machine import core_count, host_memory
from ...process.opened import OPENED

NO_CUDA = "no CUDA device"


@dataclass(frozen=True)
class BackendInfo:
    """A backend on a device.

    Attributes:
        backend: "warp", "opencl" or "reference".
        device: The name to pass as `device`.
        description: What the device is.
        version: Version of the backend's library.
        available: Whether it can trace.
        float64: Whether it computes in float64.
        memory: Memory of the device [bytes], or None if unknown.
        reason: Why "auto" chooses it or not.
        workaround: The workaround applied to the driver, and how to switch it off; empty if there is none.
    """

    backend: str
    device: str
    description: str
    version: str
    available: bool
    float64: bool
    memory: int | None
    reason: str
    workaround: str = ""

    @property
    def is_gpu(self) -> bool:
        """Whether the device is a GPU."""
        return self.device != "cpu" if self.backend == "warp" else self.description.startswith("GPU")


def known_memory() -> int | None:
    """Return the memory that this process may use [bytes], or None if the system does not report it."""
    memory = host_memory()
    return int(memory) if memory < math.inf else None


def absent(backend: str, reason: str) -> BackendInfo:
    """Return the entry of a backend without a device that can trace."""
    return BackendInfo(backend, "-", "-", "-", False, False, None, reason)


def warp_processor(version: str, reason: str, memory: bool = False) -> BackendInfo:
    """Return the description of Warp's CPU device; with `memory`, including how much this process may use."""
    text = f"{core_count()} cores, launches chunked over threads"
    return BackendInfo("warp", "cpu", text, version, True, True, known_memory() if memory else None, reason)


def cuda_driver_loads() -> bool:
    """Whether the CUDA driver's library loads; without it there is no CUDA device."""
    return bool(OPENED.once("CUDA driver", _cuda_driver_loads))


def _cuda_driver_loads() -> bool:
    names = {"win32": ("nvcuda.dll",), "darwin": ()}.get(sys.platform, ("libcuda.so.1", "libcuda.so"))
    for name in names:
        try:
            ctypes.CDLL(name)
        except OSError:
            continue
        return True
    return False
