"""What is known of a backend and its device."""

import ctypes
import math
import sys
from dataclasses import dataclass

from ...process.machine import core_count, host_memory
from ...process.opened import OPENED

NO_CUDA = "no CUDA device"


@dataclass(frozen=True)
class BackendInfo:
    """One way to trace on one device.

    Attributes:
        backend: "warp", "opencl" or "reference".
        device: The name to give as `device`.
        description: What the device is.
        version: Version of the library behind it.
        available: Whether it can trace.
        float64: Whether it computes in float64.
        memory: Memory of the device [bytes], or None where unknown.
        reason: Why it is taken or not.
        workaround: What is done to the driver so that it works, and how to switch that off; empty where nothing is.
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
    """Memory that this process may have [bytes], or None where the system does not say."""
    memory = host_memory()
    return int(memory) if memory < math.inf else None


def warp_processor(version: str, reason: str, memory: bool = False) -> BackendInfo:
    """Warp's CPU device; with `memory`, how much of it this process may have."""
    text = f"{core_count()} cores, launches chunked over threads"
    return BackendInfo("warp", "cpu", text, version, True, True, known_memory() if memory else None, reason)


def cuda_driver_loads() -> bool:
    """Whether the CUDA driver's library is there; without it nobody has a CUDA device."""
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
