"""Recognise that a device has no memory left, whichever library says so, and say it in words."""

from typing import Any

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


class memory_of:
    """Translate a library's error in this block if the device has no memory left.

    A class, since entering a generator takes several times as long.

    Raises:
        DeviceMemoryError: The device has not enough for what is done here.
    """

    __slots__ = ("device",)

    def __init__(self, device: str):
        """Take the device's name."""
        self.device = device

    def __enter__(self) -> None:
        """Do nothing."""

    def __exit__(self, kind: type[BaseException] | None, fault: BaseException | None, trace: Any) -> None:
        """Replace the error."""
        if not isinstance(fault, Exception) or isinstance(fault, DeviceMemoryError) or not lacks_memory(fault):
            return
        said = " ".join(str(fault).split())[:200]
        raise DeviceMemoryError(
            f"device {self.device!r} has not enough free memory ({said}): end other programs that use it, take a "
            "coarser grid or fewer outputs, or choose another device"
        ) from fault
