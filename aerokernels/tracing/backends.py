"""Which engines can trace here, and which one "auto" takes."""

import importlib.util

from .backend_info import BackendInfo, host_memory

BACKENDS = ("auto", "warp", "opencl", "reference")


def available_backends() -> list[BackendInfo]:
    """Every backend and device found, the one that "auto" takes first."""
    found = []
    if importlib.util.find_spec("warp") is not None:
        from .warp_devices import list_devices

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
            host_memory(),
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
    from .warp_devices import list_devices

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
