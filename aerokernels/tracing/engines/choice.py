"""List the engines that can trace on this machine, and choose the one for "auto".

The order is fixed, so that the same installation always makes the same choice: a GPU before a CPU, and on either OpenCL
if it has a device that can trace, else Warp. docs/backend-speed.md has the speeds of both.
"""

import importlib.util
import sys
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version

from aerokernels.process.quiet_warp import NoCacheError

from ...process.opened import OPENED
from .info import NO_CUDA, BackendInfo, absent, cuda_driver_loads, known_memory, warp_processor

BACKENDS = ("auto", "warp", "opencl", "reference")
KINDS = ("gpu", "cpu")


def available_backends() -> list[BackendInfo]:
    """Return every backend and device found, the one that "auto" chooses first."""
    warp, opencl = _warp_devices(memory=True), _opencl_devices()
    gpus, processors = (preferred(_of_kind(warp, kind), _of_kind(opencl, kind)) for kind in KINDS)
    if gpus:
        processors = [replace(info, reason="a GPU is preferred") for info in processors]
    return [*gpus, *processors, _reference(), *(info for info in (*warp, *opencl) if not info.available)]


def choose_backend(backend: str, device: str | None) -> tuple[str, str, str]:
    """Return the backend, the device, and the reason for the choice.

    "auto" chooses a GPU if there is one, else the CPU, and on either OpenCL if one of its devices can trace, else Warp;
    with the name of a device it chooses the backend that has the device.

    Raises:
        ValueError: An unknown or absent backend or device; the message lists what there is.
    """
    if backend not in BACKENDS:
        raise ValueError(f"backend {backend!r} is not known: choose one of {', '.join(BACKENDS)}")
    if backend == "reference":
        if device not in (None, "cpu"):
            raise ValueError(f"backend 'reference' runs on 'cpu' only, got device {device!r}")
        return "reference", "cpu", "backend reference: requested"
    if backend == "opencl":
        return _opencl_named(device)
    if backend == "warp":
        return _warp_named(_warp_devices(), device)
    warp = _warp_devices(quick=True)
    if device is None or device.lower() in ("cpu", "gpu"):
        return _best(tuple(warp), tuple(_opencl_devices()), device and device.lower())
    if any(info.available and info.device == device for info in warp):
        return "warp", device, f"backend warp on {device}: requested"
    try:
        return _opencl_named(device)
    except ValueError as error:
        names = ", ".join(info.device for info in warp if info.available) or "none"
        raise ValueError(
            f"device {device!r} is not there: backend 'warp' has {names}; by backend 'opencl': {error}"
        ) from error


@lru_cache(maxsize=8)
def _best(warp: tuple[BackendInfo, ...], opencl: tuple[BackendInfo, ...], only: str | None) -> tuple[str, str, str]:
    """As `choose_backend`: the best device of a kind ("cpu", "gpu" or None for any)."""
    for kind in KINDS if only is None else (only,):
        mine, others = _of_kind(warp, kind), _of_kind(opencl, kind)
        if mine or others:
            taken = preferred(mine, others)[0]
            if not others:
                reason = f"{taken.reason}; {_why_not(opencl)}"
            elif mine:
                reason = taken.reason
            else:
                reason = "a GPU is preferred" if kind == "gpu" else warp[0].reason
            return taken.backend, taken.device, f"backend {taken.backend} on {taken.device}: {reason}"
    if only == "gpu":
        raise ValueError(
            "device 'gpu' is not there: Warp finds no CUDA device and OpenCL no GPU that can trace; see "
            "`aerokernels backends`, or choose device 'cpu'"
        )
    raise ValueError(
        f"no backend can trace here: warp: {warp[0].reason}; {_why_not(opencl)}; backend 'reference' needs neither, "
        "and is slow"
    )


def preferred(warp: list[BackendInfo], opencl: list[BackendInfo]) -> list[BackendInfo]:
    """Return the devices of one kind ("cpu" or "gpu") of both backends, the choice of "auto" first, with reasons."""
    if not (warp and opencl):
        return warp + opencl
    reason = "OpenCL is preferred to Warp: about as fast or faster (docs/backend-speed.md)"
    taken, other = replace(opencl[0], reason=reason), replace(warp[0], reason="opencl is preferred")
    return [taken, other, *warp[1:], *opencl[1:]]


def _warp_named(warp: list[BackendInfo], device: str | None) -> tuple[str, str, str]:
    if not warp[0].available:
        raise ValueError(f"backend 'warp' cannot trace here: {warp[0].reason}")
    if device is None:
        return "warp", warp[0].device, f"backend warp on {warp[0].device}: {warp[0].reason}"
    names = [info.device for info in warp]
    if device not in names:
        raise ValueError(f"device {device!r} is not there: backend 'warp' has {', '.join(names)}")
    return "warp", device, f"backend warp on {device}: requested"


def _opencl_named(device: str | None) -> tuple[str, str, str]:
    from .opencl.devices import OpenCLUnavailable, find_device

    try:
        name = find_device(device).info.device
    except OpenCLUnavailable as error:
        raise OpenCLUnavailable(f"backend 'opencl' cannot trace here: {error}") from error
    return "opencl", name, f"backend opencl on {name}: requested"


def _warp_devices(quick: bool = False, memory: bool = False) -> list[BackendInfo]:
    """Return Warp's devices. With `quick`, Warp is not imported if there is no CUDA driver.

    The size of a device's memory is read only with `memory`, because every trace calls this function: for a GPU the
    size costs a driver context, created and destroyed in 0.17 s on an H200 if Warp has none open; for a CPU it costs
    reading a dozen files of its control groups.
    """
    if importlib.util.find_spec("warp") is None:
        return [absent("warp", "the package warp-lang is not installed: pip install warp-lang")]
    if quick and "warp" not in sys.modules and not cuda_driver_loads():
        with suppress(PackageNotFoundError):
            return [warp_processor(_version("warp-lang"), NO_CUDA)]
    from .warp.library import list_devices

    try:
        return list_devices(memory)
    except NoCacheError as error:
        return [absent("warp", str(error))]


def _version(package: str) -> str:
    """Return the version of an installed package, cached: it is read from a file, and every trace needs it."""
    return str(OPENED.once(("version", package), lambda: version(package)))


def _opencl_devices() -> list[BackendInfo]:
    from .opencl.devices import list_devices

    return list_devices()


def _of_kind(devices: Iterable[BackendInfo], kind: str) -> list[BackendInfo]:
    """Return the devices of one backend that can trace: its GPUs, or its other devices."""
    return [info for info in devices if info.available and info.is_gpu == (kind == "gpu")]


def _reference() -> BackendInfo:
    import scipy

    text = "float64 NumPy (DOP853 within one smooth piece of the field after another): the oracle, slow"
    return BackendInfo("reference", "cpu", text, scipy.__version__, True, True, known_memory(), "never chosen by auto")


def _why_not(opencl: Iterable[BackendInfo]) -> str:
    """Say in one line why Warp is chosen and not OpenCL."""
    broken = "; ".join(info.reason for info in opencl if not info.available)
    return " ".join(f"no OpenCL: {broken}".split()) if broken else "OpenCL has no device of that kind"
