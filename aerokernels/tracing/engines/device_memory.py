"""Recognise that a device has no memory left, whichever library says so, and say it in words."""

from collections.abc import Iterator
from contextlib import contextmanager

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
