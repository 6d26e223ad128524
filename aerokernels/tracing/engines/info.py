"""The description of a backend on a device, cheap checks for what this machine has, and devices without memory left."""

import ctypes
import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
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


# A device's memory is shared with other programs, so its total size says too little.
CODES = (-4, -5, -6)  # OpenCL's CL_MEM_OBJECT_ALLOCATION_FAILURE, CL_OUT_OF_RESOURCES, CL_OUT_OF_HOST_MEMORY
WORDS = ("Failed to allocate", "Failed to acquire primary context", "out of memory")  # of Warp, which has no codes


class DeviceMemoryError(MemoryError):
    """A device has not enough free memory; the message names it and says what to do."""


def lacks_memory(fault: Exception) -> bool:
    """Return whether a library reports that a device has no memory left."""
    if isinstance(fault, DeviceMemoryError):
        return True
    if type(fault) is RuntimeError:
        return any(word in str(fault) for word in WORDS)
    return type(fault).__module__.split(".")[0] == "pyopencl" and getattr(fault, "code", None) in CODES


@contextmanager
def memory_of(device: str) -> Iterator[None]:
    """Translate a library's error in this block if the device has no memory left.

    Raises:
        DeviceMemoryError: The device has not enough for what is done here.
    """
    try:
        yield
    except Exception as fault:
        if isinstance(fault, DeviceMemoryError) or not lacks_memory(fault):
            raise
        said = " ".join(str(fault).split())[:200]
        raise DeviceMemoryError(
            f"device {device!r} has not enough free memory ({said}): end other programs that use it, take a coarser "
            "grid or fewer outputs, or choose another device"
        ) from fault
