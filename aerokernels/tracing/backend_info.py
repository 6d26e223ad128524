"""What a backend tells of itself."""

import os
from dataclasses import dataclass


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
    """

    backend: str
    device: str
    description: str
    version: str
    available: bool
    float64: bool
    memory: int | None
    reason: str


def host_memory() -> int | None:
    """Memory of this machine [bytes], or None where it does not say."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (ValueError, OSError, AttributeError):
        return None
