"""Which engines can trace here, and which one "auto" takes."""

import importlib.util
import os
from dataclasses import dataclass

BACKENDS = ("auto", "warp", "opencl", "reference")


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


def available_backends() -> list[BackendInfo]:
    """Every backend and device found, the one that "auto" takes first."""
    found = []
    if importlib.util.find_spec("warp") is not None:
        from .warp_backend import list_devices

        found += list_devices()
    else:
        found.append(_absent("warp", "the package warp-lang is not installed: pip install warp-lang"))
    found.append(
        _absent("opencl", "this version has no OpenCL tracer yet: use backend 'warp', on the CPU or on an NVIDIA GPU")
    )
    import scipy

    found.append(
        BackendInfo(
            "reference",
            "cpu",
            "float64 NumPy and SciPy (DOP853), one ray at a time: the oracle, slow",
            scipy.__version__,
            True,
            True,
            _host_memory(),
            "never taken by auto",
        )
    )
    return found


def choose_backend(backend: str, device: str | None) -> tuple[str, str, str]:
    """Backend, device, and why.

    Raises:
        ValueError: An unknown or absent backend or device; the message says what there is.
    """
    if backend not in BACKENDS:
        raise ValueError(f"backend {backend!r} is not known: choose one of {', '.join(BACKENDS)}")
    if backend == "reference":
        if device not in (None, "cpu"):
            raise ValueError(f"backend 'reference' runs on 'cpu' only, got device {device!r}")
        return "reference", "cpu", "backend reference: asked for"
    if backend == "opencl" or importlib.util.find_spec("warp") is None:
        reason = next(info.reason for info in available_backends() if info.backend == "opencl" or not info.available)
        raise ValueError(f"backend {backend!r} cannot trace here: {reason}")
    from .warp_backend import list_devices

    devices = list_devices()
    names = [info.device for info in devices]
    if device is None:
        best = devices[0]
        return "warp", best.device, f"backend warp on {best.device}: {best.reason}"
    if device not in names:
        raise ValueError(f"device {device!r} is not there: backend 'warp' has {', '.join(names)}")
    return "warp", device, f"backend warp on {device}: asked for"


def _absent(backend: str, reason: str) -> BackendInfo:
    return BackendInfo(backend, "-", "-", "-", False, False, None, reason)


def _host_memory() -> int | None:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (ValueError, OSError, AttributeError):
        return None
